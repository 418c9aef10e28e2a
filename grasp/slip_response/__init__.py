"""Responses to slip: what hand and arm do from when it is registered until it is over."""

from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.lift_line import LiftLine
from grasp.slip_response.base import SlipResponse
from grasp.slip_response.close import Close
from grasp.slip_response.stop_and_close import StopAndClose
from grasp.slip_response.stop_and_step import StopAndStep

RESPONSES: dict[str, type[SlipResponse]] = {
    "jump": Close,
    "stop_and_jump": StopAndClose,
    "stop_and_step": StopAndStep,
}


def make_response(settings: ControllerSettings, plan: GripPlan, line: LiftLine) -> SlipResponse:
    """The response that the settings choose."""
    return RESPONSES[settings.answer](settings, plan, line)
