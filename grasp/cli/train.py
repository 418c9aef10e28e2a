"""`grasp detector train`: fit a network and write its weights. Needs the extra `train`."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drivers.errors import UsageError
from grasp import signals
from grasp.cli import exits
from grasp.cli.options import decimal, need, progress, seed, whole
from grasp.cli.parser import verb
from grasp.cli.places import file_with_folders, must_be_writable, must_have_room

NETWORKS = ("tcn", "gru", "tcn-paper", "freq-cnn-paper")
NO_LIMIT_MINUTES = 1e9
TELL_S = 10.0  # at least so often how far it is
ROOM_BYTES = 2_000_000  # two checkpoints, weights and log of the largest network
# options that are settings of a training
ASKED = (
    *("seed", "steps", "augmentation", "balance", "label", "moved_m"),
    *("validations", "patience"),
)


def add_parser(actions: Any) -> None:
    parser = verb(actions, "train", train, "train a network on data sets and write its weights "
        "(extra `train`)", ". One thread. Trains on the split `train`, stops early and calibrates "
        "on the split `validation`, never uses `test`.")  # fmt: skip
    parser.option("network NAME", ", ".join(NETWORKS), choices=NETWORKS)
    parser.option("--data DIR", "folders of `grasp dataset build`, or `collect`", Path, nargs="+",
        required=True)  # fmt: skip
    parser.option("--out FILE.onnx", "weights to write (default: NAME.onnx here); checkpoint and "
        "log are beside it, and start again without --resume", file_with_folders)  # fmt: skip
    parser.flag("--force", "overwrite --out, and the files of an unfinished training beside "
        "it")  # fmt: skip
    parser.option("--seed N", "", seed, default=0)
    parser.option("--steps N", "optimiser steps", whole(1, 10**9))
    parser.option("--validations N", "validations, evenly over the steps (default: the "
        "network's)", whole(1, 1000))  # fmt: skip
    parser.option("--patience N", "stop after this many validations without improvement (default: "
        "8)", whole(1, 1000))  # fmt: skip
    parser.option("--minutes M", "processor minutes after which it ends with what it has (default: "
        "no limit)", decimal(0, NO_LIMIT_MINUTES), default=NO_LIMIT_MINUTES)  # fmt: skip
    parser.option("--augmentation", "four symmetries at 25 %% and noise of 1 %% of the range (the "
        "paper's text), half turns at 75 %% and noise of half a count (its code as it ran), or "
        "ours: symmetries, gain, offset, noise, lost samples, dead, stuck and swapped taxels",
        choices=("none", "paper", "as-run", "ours"))  # fmt: skip
    parser.option("--balance", "weight the classes, or (windows only) draw equal numbers per epoch",
        choices=("weights", "undersample"))  # fmt: skip
    parser.flag("--windows", "tcn-paper: learn from the last sample of windows alone, at one rate, "
        "as its authors did")  # fmt: skip
    parser.option("--label", "what to learn: slip by the fingertip's speed, slip of the contact "
        "itself, or distance from where it last rested (default: slip)",
        choices=("slip", "slip_true", "moved"))  # fmt: skip
    parser.option("--moved-m M", "of the label moved: further than this, in metres (default: "
        "0.001)", decimal(1e-5, 0.1))  # fmt: skip
    parser.flag("--resume", "continue from the checkpoint beside --out")
    parser.flag("--json", "the network's card as one JSON object")


def train(args: argparse.Namespace) -> int:
    need("train", "torch", "onnx")
    from detector.network_file import SUFFIX

    out = args.out or Path(f"{args.network}{SUFFIX}")
    if out.suffix != SUFFIX:
        raise UsageError(f"{out}: weights go by their {SUFFIX}", f"--out {out.with_suffix(SUFFIX)}")
    checkpoint = out.with_suffix(".checkpoint")
    _check_places(args, out, checkpoint)
    training, validation = _prepare(args)
    if args.resume:
        training.resume(checkpoint)
    try:
        card = _fit(args, training, validation, out)
    except KeyboardInterrupt:
        if training.step == 0:
            raise
        told = f"interrupted at step {training.step} of {training.settings.steps}, kept"
        how = "the same command with --resume goes on from there"
        return exits.report("interrupted", f"{told} in {checkpoint}", how, args.json)
    checkpoint.unlink(missing_ok=True)
    _tell(args, card, training, out)
    return exits.SUCCESS


def _check_places(args: argparse.Namespace, out: Path, checkpoint: Path) -> None:
    """Whether weights, log and checkpoint may be written, before any data are read."""
    out.parent.mkdir(parents=True, exist_ok=True)
    must_be_writable(out)
    if out.is_file() and not (args.force or args.resume):
        raise UsageError(f"{out} is there already", "name another with --out, or --force")
    if checkpoint.is_file() and not (args.force or args.resume):
        raise UsageError(
            f"{checkpoint} is of a training that did not end",
            "--resume goes on with it, --force begins anew",
        )
    must_have_room(checkpoint, ROOM_BYTES)


def _fit(args: argparse.Namespace, training: Any, validation: list[Any], out: Path) -> Any:
    """Train to the end and write the weights; gives their card. An interruption waits for the end
    of a step, so that the checkpoint is of whole ones."""
    from detector.training.export import export
    from scenarios.trial.result import versions

    with (
        _log(out.with_suffix(".log"), "a" if args.resume else "w") as log,
        progress("training", hidden=args.json, every_s=TELL_S) as show,
        signals.deferred(),
    ):
        reporter = Reporter(log, show, args.minutes)
        training.run(args.minutes, out.with_suffix(".checkpoint"), reporter.tell)
    signals.check()
    return export(training, validation, out, versions()["commit"])


@contextmanager
def _log(path: Path, mode: str) -> Iterator[Any]:
    """The log of a training; where that fails, none that is empty stays. Raises OSError with its
    name: a full disk says none of its own."""
    try:
        with path.open(mode, encoding="utf-8") as log:
            yield log
    except BaseException as error:
        if path.is_file() and path.stat().st_size == 0:
            path.unlink()
        if isinstance(error, OSError) and error.filename is None:
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise


def _tell(args: argparse.Namespace, card: Any, training: Any, out: Path) -> None:
    import msgspec

    if args.json:
        print(msgspec.json.encode(card).decode())
        return
    print(f"{out}: {card.parameters} parameters, {card.steps} steps, "
          f"{card.training_minutes:.1f} processor minutes, accuracy on validation "
          f"{card.validation['accuracy']:.3f} (calibrated, on the paper's kind if there is "
          "any; the log's is of all recordings)")  # fmt: skip
    if training.step < training.settings.steps:
        why = "validation stood still" if training.stands_still else "its minutes were spent"
        option = "--patience" if training.stands_still else "--minutes"
        exits.say(f"ended before its {training.settings.steps} steps: {why} ({option})")
    rule = out.with_suffix(".toml")
    if rule.is_file():
        exits.say(f"{rule} beside it is of other weights: `grasp detector tune` makes another")


def _prepare(args: argparse.Namespace) -> tuple[Any, list[Any]]:
    """The training, ready to run, and the validation recordings."""
    from scenarios.benchmark.data_sets import require_whole

    require_whole(args.data)  # before torch, which takes seconds
    import msgspec

    from detector.recordings import read_dataset
    from detector.training.fit import Training
    from detector.training.sequences import digest
    from detector.training.settings import DEFAULTS, WINDOWS, TrainSettings

    learnt = [r for folder in args.data for r in read_dataset(folder, "train")]
    validation = [r for folder in args.data for r in read_dataset(folder, "validation")]
    asked = {name: getattr(args, name) for name in ASKED if getattr(args, name) is not None}
    if args.windows:
        asked = WINDOWS | asked
    table = msgspec.structs.asdict(DEFAULTS[args.network]) | asked
    settings = msgspec.convert(table, TrainSettings)
    used = digest([*learnt, *validation])
    return Training(args.network, settings, learnt, validation, used), validation


class Reporter:
    """How far it is for a person, one plain line a validation for the log."""

    def __init__(self, log: Any, show: Any, minutes: float = NO_LIMIT_MINUTES) -> None:
        """``minutes``: of the processor, after which the training ends."""
        self._log = log
        self._show = show
        self._minutes = minutes
        self._smooth: float | None = None  # none yet, of a training that is resumed too

    def tell(self, p: Any) -> None:
        before = p.loss if self._smooth is None else self._smooth
        self._smooth = 0.98 * before + 0.02 * p.loss
        best = f", best delay {p.best.delay_ms:.0f} ms" if p.best else ""
        self._show(p.step, self._last_step(p), f"training, loss {self._smooth:.3f}{best}")
        if p.score is not None:
            s = p.score
            self._log.write(
                f"step {p.step} minutes {p.minutes:.2f} loss {self._smooth:.4f} validation "
                f"loss {s.loss:.4f} accuracy {s.accuracy:.4f} delay_ms {s.delay_ms:.1f}\n"
            )
            self._log.flush()
        signals.check()

    def _last_step(self, p: Any) -> int:
        """Where it ends: with its steps, or with its minutes before, at the pace until now."""
        if self._minutes >= NO_LIMIT_MINUTES or p.minutes <= 0.0:
            return int(p.steps)
        return int(max(p.step, min(p.steps, p.step * self._minutes / p.minutes)))
