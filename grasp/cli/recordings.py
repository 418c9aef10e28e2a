"""`grasp replay`, `runs`, `report` and `export`: replay, list, plot and export recordings."""

import io
import json
from collections.abc import Sequence
from pathlib import Path

from drivers.errors import BadFile, UsageError, one_line
from grasp.cli import exits
from grasp.cli.commands import ExportOptions, ReplayOptions, ReportOptions, RunsOptions
from grasp.cli.options import PICTURES, check_new, check_writable, need
from grasp.cli.output import JsonObject, print_status, show
from grasp.files import is_stream, write_whole

SHOWN_DIFFERENCES = 10
LAYOUT = "foxglove-layout.json"
LAYOUT_BEGINS = '{\n "configById"'
REPORTED = "give the folder of a lift, a tap or a benchmark, a campaign's .sqlite or scores' .json"
FORMATS = {".csv": "csv", ".json": "layout", ".gif": "gif", **dict.fromkeys(PICTURES, "svg")}
FOLDERS = {"lerobot": "pyarrow", "rosbag": "rosbags"}  # formats that are folders: their package


def replay(args: ReplayOptions) -> int:
    if args.run is not None and args.tactile is not None:
        raise UsageError("takes a RUN or --tactile PATH, and not both", "give one of them")
    if args.tactile is not None and args.check:
        raise UsageError("--check compares a run with its recording", "leave it out")
    if args.tactile is not None:
        return _replay_tactile(args, args.tactile)
    if args.config or args.set:
        raise UsageError("--config and --set need --tactile: a run is replayed with its recorded "
                         "settings", "leave them out")  # fmt: skip
    import msgspec

    from scenarios.trial.replay import replay_run

    done = replay_run(args.run or _last_run(), args.detector)
    same = not done.differences

    def text() -> str:
        cut = "" if done.complete else " (the recording is incomplete)"
        more = len(done.differences) - SHOWN_DIFFERENCES
        return "\n".join([
            *(f"{t_s:7.2f} s  {what}" for t_s, what in done.events),
            f"{done.steps} steps replayed, {done.writes} writes to the gripper compared{cut}: "
            f"{'as recorded' if same else 'DIFFERENT'}",
            *(f"  {d.t_s:7.2f} s  {d.what}: recorded {d.recorded}, replayed {d.replayed}"
              for d in done.differences[:SHOWN_DIFFERENCES]),
            *([f"  and {more} more"] if more > 0 else []),
        ])  # fmt: skip

    code = exits.TRIAL_FAILED if args.check and not same else exits.SUCCESS
    return show(args, {**msgspec.to_builtins(done), "same": same}, text, code)


def _last_run() -> Path:
    """Folder of the newest lift or tap in the default folder, which it prints. Raises UsageError if
    there is none."""
    from detector.recordings import SAMPLES
    from scenarios.trial.run_folder import RECORDING, RUNS, newest

    if not (recordings := [run for run in newest(RECORDING) if not any(run.glob(SAMPLES))]):
        raise UsageError(f"no RUN given, and no lift or tap in the folder {RUNS}",
                         "give the path of a RUN, or record one: `grasp run lift`")  # fmt: skip
    print_status(f"last run: {one_line(recordings[0])}")
    return recordings[0]


def _replay_tactile(args: ReplayOptions, path: Path) -> int:
    import msgspec

    from detector.recordings import files_of, read
    from grasp.cli.detector import scores_text, warn
    from scenarios.campaign.config import load_config
    from scenarios.trial.replay_tactile import replay_tactile, score

    config = load_config("can", "simulated", args.detector, args.config, args.set)
    if len(files := files_of(path)) > 1:
        names = ", ".join(file.name for file in files)
        raise UsageError(f"{path} has {len(files)} recordings", f"give one of them: {names}")
    recording = read(files[0])
    warnings = warn(args, [recording])
    done, scores = replay_tactile(config, recording), score(config, recording)

    def text() -> str:  # labels, registered events and commands on one time line, then the score
        slip = recording.slip
        lines = [
            *((float(recording.t_s[i]), f"label: slip {'begins' if slip[i] else 'ends'}")
              for i in range(1, len(slip)) if slip[i] != slip[i - 1]),
            *((t_s, f"    registered at finger {finger}") for t_s, finger in done.registered),
            *((c.t_s, f"        {c.phase}: {c.text}") for c in done.commands),
        ]  # fmt: skip
        lines.sort(key=lambda line: line[0])
        shown = [f"{t_s:8.3f} s  {what}" for t_s, what in lines]
        last = scores_text(scores, config.rule) if scores else "no label `slip`: no score"
        return "\n".join([*shown, last])

    value = {**msgspec.to_builtins(done), "evaluation": scores, "warnings": warnings}
    return show(args, value, text)


def runs(args: RunsOptions) -> int:
    if args.file is not None:
        from grasp.cli.campaign import show_summary

        return show_summary(args, args.file)
    from scenarios.trial.run_folder import run_order

    results, lines, code = [], [], exits.SUCCESS
    found = sorted(args.runs.glob("*/result.json"), key=lambda path: run_order(path.parent))
    for path in found:
        try:
            result = json.loads(path.read_bytes())
            lines.append(_line(path.parent.name, result))
            results.append(result)
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
            bad = BadFile(path, "is no result of a run, or damaged", "delete or move its folder")
            code = exits.report(bad.kind, bad.message, bad.remedy, as_json=False)
    return show(args, results, "\n".join(lines) or f"no runs in {one_line(args.runs)}", code)


def _line(name: str, result: JsonObject) -> str:
    slip = result.get("slip_distance_m", result.get("displacement_m"))
    details = "" if slip is None else f"slip {slip * 1e3:5.1f} mm"
    if "samples" in result:
        details = "{samples} samples, {slip} slip, direction {direction}".format(**result)
    seed = f"seed {result['seed']:<6}"
    return one_line(f"{name:<36}  {result['outcome']:<18}  {seed}  {details}".rstrip())


def report(args: ReportOptions) -> int:
    if args.out is not None and args.out.suffix != ".html":
        raise UsageError(f"--out {args.out}: not an HTML file name", "use one that ends in .html")
    print(write_page(args.run or _last_run(), args.out))
    return exits.SUCCESS


def write_page(run: Path, out: Path | None = None) -> Path:
    """Write the page of one run, campaign, evaluation or benchmark. Raises BadFile for other files,
    UsageError if the page would overwrite a different file."""
    from scenarios.campaign.store import is_database
    from scenarios.report.campaign_page import campaign_page
    from scenarios.report.page import BEGINS
    from scenarios.report.run_page import page_path, run_page
    from scenarios.trial.run_folder import find_recording

    if (found := run / "benchmark.json").is_file():
        run = found
    database, evaluation = is_database(run), run.suffix == ".json"
    if not (database or evaluation or find_recording(run).exists()):
        raise BadFile(run, "no recording of a run, campaign, score file or benchmark", REPORTED)
    path = out or (run.with_suffix(".html") if database or evaluation else page_path(run))
    check_writable(path, BEGINS)
    if database:
        page = campaign_page(run, path)
    elif evaluation:
        from scenarios.report.score_page import score_page  # needs the compiled world

        page = score_page(run)
    else:
        page = run_page(run)
    write_whole(path, page.encode(), private=True)
    return path


def export(args: ExportOptions) -> int:
    from scenarios.campaign.store import is_database

    by_name = None if args.out is None else FORMATS.get(args.out.suffix)
    if args.to is None and args.out is not None and by_name is None:
        raise UsageError(f"--out {args.out}: no known file ending",
                         f"use a name that ends in {', '.join(FORMATS)}, or give --to")  # fmt: skip
    to = args.to or by_name or "csv"
    if by_name not in (None, to):
        raise UsageError(f"--out {args.out}: the file name says {by_name}, --to says {to}",
                         "leave --to out, or use another file name")  # fmt: skip
    runs = args.run or [_last_run()]
    run, database = runs[0], is_database(runs[0])
    if len(runs) > 1 and to != "lerobot":
        raise UsageError(
            f"{len(runs)} RUNs cannot be exported together as {to}", "give one of them"
        )
    if campaign := next((run for run in runs if to != "csv" and is_database(run)), None):
        raise UsageError(f"{campaign}: a campaign cannot be exported as {to}", "use --to csv")
    if to in ("svg", "gif"):
        print(_draw(run, args.out, to))
        return exits.SUCCESS
    if to in FOLDERS:
        print(_fill(runs, args.out, to))
        return exits.SUCCESS
    default, content, begins = _campaign_file(run) if database else _run_file(run, to)
    out = args.out or default
    check_writable(out, begins)
    write_whole(out, content.encode(), private=True)
    if not is_stream(out):
        print(out)
    return exits.SUCCESS


def _run_file(run: Path, to: str) -> tuple[Path, str, str]:
    """Default path, content and first characters of a run's table, or of a viewer's layout."""
    from grasp.settings import config_dir
    from scenarios.report.export import BEGINS, as_csv
    from scenarios.trial.run_folder import find_recording, open_trial

    recording = find_recording(run)
    if to == "csv":
        return recording.with_suffix(".csv"), as_csv(run), BEGINS
    open_trial(run)  # raises BadFile
    content = (config_dir() / "viewers" / "foxglove.json").read_text("utf-8")
    return recording.with_name(LAYOUT), content, LAYOUT_BEGINS


def _campaign_file(file: Path) -> tuple[Path, str, str]:
    from scenarios.campaign.store import COLUMNS, CampaignStore

    text = io.StringIO(newline="")
    with CampaignStore.open(file) as store:
        store.write_csv(text)
    return file.with_suffix(".csv"), text.getvalue(), ",".join(COLUMNS[:3])


def _draw(run: Path, out: Path | None, to: str) -> Path:
    need("exports", "matplotlib")
    from scenarios.report.animation import animate_run
    from scenarios.report.export import draw_run
    from scenarios.trial.run_folder import RECORDING, find_recording

    recording = find_recording(run)
    name = "run" if recording.name == RECORDING else recording.stem
    out = out or recording.with_name(f"{name}.{to}")
    endings = PICTURES if to == "svg" else (".gif",)
    if out.suffix not in endings:
        raise UsageError(f"--out {out}: not an image file name",
                         f"use a name that ends in {', '.join(endings)}")  # fmt: skip
    check_new(out)
    (draw_run if to == "svg" else animate_run)(run, out)
    return out


def _fill(runs: Sequence[Path], out: Path | None, to: str) -> Path:
    need("exports", FOLDERS[to])
    from scenarios.report.lerobot_export import write_lerobot
    from scenarios.report.rosbag_export import write_rosbag
    from scenarios.trial.run_folder import find_recording

    if out is None and len(runs) > 1:
        raise UsageError("--out is missing: a data set of several RUNs needs a name",
                         "add --out FOLDER")  # fmt: skip
    out = out or find_recording(runs[0]).with_suffix(f".{to}")
    check_new(out)
    if to == "rosbag":
        write_rosbag(runs[0], out)
    else:
        write_lerobot(runs, out)
    return out
