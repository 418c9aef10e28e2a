"""`grasp dataset`: build or collect labelled recordings. `grasp detector train`: train a network on
them and write its weights (extra `train`)."""

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from detector.network_file import WEIGHTS_SUFFIX
from detector.recordings import SUFFIX, Recording, write
from detector.scores.evaluation import WARM_UP_SAMPLES
from drivers.errors import UsageError, one_line
from drivers.interfaces import KIT_TAXELS
from grasp.cli import exits
from grasp.cli.commands import (
    DatasetBuildOptions,
    DatasetCollectOptions,
    DatasetImportOptions,
    TrainOptions,
)
from grasp.cli.detector import warn
from grasp.cli.options import check_writable, need, workers
from grasp.cli.output import progress, show
from grasp.run import signals
from grasp.settings import file_of
from scenarios.acquire.import_recording import ImportOptions, import_recording
from scenarios.benchmark.data_sets import read_set, require_whole
from scenarios.benchmark.scoring import too_short
from scenarios.trial.result import versions
from scenarios.trial.run_folder import RUNS
from scenarios.world import COMPILING, is_compiled

if TYPE_CHECKING:
    from detector.network_file import NetworkCard
    from detector.training.fit import Training
    from detector.training.validation import Score

PROGRESS_S = 10.0  # longest time between two progress lines of a training
# options that are settings of a training
SETTINGS = ("seed", "steps", "augmentation", "label", "validations")


def dataset_build(args: DatasetBuildOptions) -> int:
    from scenarios.acquire.datasets import build
    from scenarios.acquire.datasets.plan import load_dataset_config, plan, reduced

    config = reduced(load_dataset_config(file_of("datasets", args.config)), args.share)
    if args.seed is not None:
        config = msgspec.structs.replace(config, seed=args.seed)
    jobs = plan(config)
    planned = f"{len(jobs)} recordings"
    if short := sum(job.samples <= WARM_UP_SAMPLES for job in jobs):
        planned += f"; {too_short(short)}: a larger --share makes them longer"
    exits.print_detail(planned)
    if not is_compiled():
        exits.print_detail(COMPILING)
    finished = 0
    with progress("recordings", hidden=args.json) as bar:

        def report(done: int, total: int) -> None:
            nonlocal finished
            finished = done
            bar(done, total)

        try:
            made = build.build(jobs, config, args.out, workers(args), report)
        except KeyboardInterrupt:
            kept = f"{finished} of {len(jobs)} recordings are in {args.out}"
            return exits.report("interrupted", kept, "run the same command again", args.json)
    samples = sum(job.samples for job in jobs)
    value = {"folder": args.out, "recordings": len(jobs), "made": made, "samples": samples}
    text = f"{args.out}: {len(jobs)} recordings, {samples} samples; {made} made now"
    return show(args, value, text)


def dataset_collect(args: DatasetCollectOptions) -> int:
    from scenarios.acquire.datasets import build

    made = build.collect(args.source, args.out)
    counts = ", ".join(f"{n} for {split}" for split, n in made.counts.items())
    value = {"folder": args.out, "lacking": made.lacking, "warnings": warn(args, made.recordings)}
    show(args, value | {**made.counts}, f"{args.out}: {counts}")
    if made.lacking and not args.json:
        for split, kinds in made.lacking.items():
            exits.print_detail(f"none for {split}: {', '.join(kinds)}")
        exits.print_detail("each split needs three recordings of a motion on a surface")
    return exits.SUCCESS


def dataset_import(args: DatasetImportOptions) -> int:
    if args.labels and len(args.file) > 1:
        raise UsageError("--labels belongs to one FILE", "import one after the other")
    options = ImportOptions(
        time_column=args.time_column, rate_hz=args.rate, unit=args.unit or "", columns=args.columns,
        taxels=args.taxels, sign=args.sign, scale=args.scale, rest_s=args.rest_seconds,
        labels=args.labels, resample=args.resample,
    )  # fmt: skip
    imported: dict[Path, tuple[Recording, list[str]]] = {}
    for file in args.file:
        out = args.out / f"{file.stem}{SUFFIX}"
        if out in imported or out.exists():
            raise UsageError(f"{out} exists already", "rename the file, or give another --out")
        imported[out] = import_recording(file, options)
    args.out.mkdir(parents=True, exist_ok=True)
    for out, (recording, changes) in imported.items():
        write(out, recording)
        sha256 = {} if recording.metadata is None else recording.metadata.files
        warnings = warn(args, [recording])
        value = {"file": out, "samples": len(recording.t_s), "fingers": recording.fingers,
                 "changes": changes, "sha256": sha256, "warnings": warnings}  # fmt: skip
        hashes = [f"SHA-256 of {name}: {digest}" for name, digest in sha256.items()]
        text = f"{out}: {len(recording.t_s)} samples, fingers: {recording.fingers}"
        lines = [one_line(line, exits.MAX_CHARACTERS) for line in (text, *changes, *hashes)]
        show(args, value, "\n  ".join(lines))
    if not args.json:
        print(f"next: `{_after_import(args, imported)}`")
    return exits.SUCCESS


def _after_import(args: DatasetImportOptions, made: dict[Path, tuple[Recording, list[str]]]) -> str:
    """The command that uses the imported recordings."""
    for out, (recording, _) in made.items():
        if not recording.labelled:
            return shlex.join(("grasp", "replay", "--tactile", str(out)))
    detector = "tcn" if args.taxels == KIT_TAXELS else "energy"
    source = ("--recording", str(next(iter(made)))) if len(made) == 1 else ("--data", str(args.out))
    return shlex.join(("grasp", "detector", "evaluate", detector, *source))


def detector_train(args: TrainOptions) -> int:
    need("train", "torch", "onnx")
    out = args.out or RUNS / f"{args.network}{WEIGHTS_SUFFIX}"
    if out.suffix != WEIGHTS_SUFFIX:
        raise UsageError(
            f"{out} does not end in {WEIGHTS_SUFFIX}", f"--out {out.with_suffix(WEIGHTS_SUFFIX)}"
        )
    checkpoint = out.with_suffix(".checkpoint")
    _check_files(args, out, checkpoint)
    training, validation = _prepare(args)
    if args.resume:
        training.resume(checkpoint)
    try:
        card = _fit(args, training, validation, out)
    except KeyboardInterrupt:
        if training.step == 0:
            raise
        text = f"interrupted at step {training.step} of {training.settings.steps}, saved"
        how = "to continue, run the same command with --resume"
        return exits.report("interrupted", f"{text} in {checkpoint}", how, args.json)
    checkpoint.unlink(missing_ok=True)
    show(args, card, f"{out}: {card.parameters} parameters, {card.steps} steps, "
        f"{card.training_minutes:.1f} processor minutes, accuracy on validation "
        f"{card.validation['accuracy']:.3f} (calibrated, on recordings of the paper's kind if "
        "there are any; the log's is of all recordings)")  # fmt: skip
    if training.step < training.settings.steps:
        exits.print_detail("stopped early: the validation score no longer improved")
    if (rule := out.with_suffix(".toml")).is_file():
        exits.print_detail(f"{rule} is for other weights: `grasp detector tune` makes a new rule")
    return exits.SUCCESS


def _check_files(args: TrainOptions, out: Path, checkpoint: Path) -> None:
    """Check, before data are read, whether weights and checkpoint may be written."""
    out.parent.mkdir(parents=True, exist_ok=True)
    check_writable(out)
    if args.force or args.resume:
        return
    if out.is_file():
        raise UsageError(f"{out} exists already", "name another with --out, or add --force")
    if checkpoint.is_file():
        raise UsageError(f"{checkpoint} is of an unfinished training",
                         "--resume continues it, --force starts again")  # fmt: skip


def _prepare(args: TrainOptions) -> "tuple[Training, list[Recording]]":
    require_whole(args.data)  # before torch, which takes seconds
    from detector.training.fit import Training
    from detector.training.sequences import digest
    from detector.training.settings import DEFAULTS, WINDOWS, TrainSettings

    learnt: list[Recording] = []
    validation: list[Recording] = []
    for folder in args.data:
        learnt += read_set(folder, "train", exits.print_detail)
        validation += read_set(folder, "validation")
    given = {name: getattr(args, name) for name in SETTINGS if getattr(args, name) is not None}
    if args.windows:
        given = WINDOWS | given
    table = msgspec.structs.asdict(DEFAULTS[args.network]) | given
    settings = msgspec.convert(table, TrainSettings)
    used = digest([*learnt, *validation])
    return Training(args.network, settings, learnt, validation, used), validation


def _fit(
    args: TrainOptions, training: "Training", validation: list[Recording], out: Path
) -> "NetworkCard":
    """Train and write the weights; returns their card. An interruption waits for the end of a
    step."""
    from detector.training.export import export

    with (
        out.with_suffix(".log").open("a" if args.resume else "w", encoding="utf-8") as log,
        progress("training", hidden=args.json, every_s=PROGRESS_S) as bar,
        signals.deferred(),
    ):
        smooth: float | None = None

        def report(
            loss: float, s: "Score | None"
        ) -> None:  # a log line for each validation's score
            nonlocal smooth
            smooth = loss if smooth is None else 0.98 * smooth + 0.02 * loss
            best = f", best delay {training.best.delay_ms:.0f} ms" if training.best else ""
            bar(training.step, training.settings.steps, f"training, loss {smooth:.3f}{best}")
            if s is not None:
                log.write(
                    f"step {training.step} minutes {training.minutes:.2f} loss {smooth:.4f} "
                    f"validation loss {s.loss:.4f} accuracy {s.accuracy:.4f} "
                    f"delay_ms {s.delay_ms:.1f}\n"
                )
                log.flush()
            signals.check()

        training.run(math.inf, out.with_suffix(".checkpoint"), report)
    signals.check()
    return export(training, validation, out, versions()["commit"])
