"""Slip responses: commands to hand and arm from the registration of slip until it is over."""

from grasp.control.slip_response.close import SlipResponse
from grasp.control.slip_response.stop_and_close import StopAndClose
from grasp.control.slip_response.stop_and_step import StopAndStep

RESPONSES: dict[str, type[SlipResponse]] = {
    "close": SlipResponse,
    "stop_and_close": StopAndClose,
    "stop_and_step": StopAndStep,
}  # by the setting `controller.slip_response`
