"""Close: the hand closes to the force cap, and the arm goes on as it did (the paper's loop)."""

from grasp.commands import Command
from grasp.observation import Observation
from grasp.slip_response.base import SlipResponse


class Close(SlipResponse):
    """The fastest closure, and no more."""

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        return self.close(obs, lost)
