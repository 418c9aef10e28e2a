"""Records an episode of `grasp/Lift-v0` as a run folder for `grasp report`."""

from pathlib import Path

from drivers.interfaces import Applied
from grasp.control.states import PhaseChange
from grasp.control.step import StepResult
from grasp.policy_reflex import Admitted, PolicyCommand
from grasp.run.clock import Clock
from grasp.run.loop import Issued, Tick
from grasp.run.messages import PHASES, TRUTH, write_tick
from scenarios.trial.config import TrialConfig
from scenarios.trial.run_folder import POLICY, RUN_CHANNELS, RunFolder, metadata
from scenarios.world.truth import Truth


class EpisodeRecording:
    """Recording of one episode. The phases are the states of the reflex."""

    def __init__(self, runs: Path, config: TrialConfig, seed: int, clock: Clock) -> None:
        """Make a folder in ``runs``; raises CouldNotRecord."""
        known = {**metadata(config, seed, clock), "config_hash": config.digest(), POLICY: "yes"}
        self._folder = RunFolder(runs, f"lift-{config.object.name}", RUN_CHANNELS, known)
        self._phase = ""

    def write(
        self, step: StepResult, wanted: PolicyCommand, admitted: Admitted,
        applied: Applied | None, truth: Truth,
    ) -> None:  # fmt: skip
        """Add one control step, with the command to the hand that was sent in it."""
        now_ns, phase, write = step.observation.t_ns, str(admitted.state), self._folder.write
        issued: tuple[Issued, ...] = ()
        if admitted.hand is not None:
            issued = (Issued(now_ns, now_ns, wanted.hand, admitted.hand, applied),)
        write_tick(write, Tick(step.observation, step.decision, issued))
        if phase != self._phase:
            self._phase = phase
            write(PHASES, now_ns, PhaseChange(phase, now_ns, "state of the reflex"))
        write(TRUTH, now_ns, truth)

    def close(self) -> None:
        """Complete the recording; raises CouldNotRecord."""
        self._folder.abandon()
        self._folder.check()
