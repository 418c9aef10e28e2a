"""`grasp run SCENARIO`: lifts, taps or an acquisition, displayed and recorded; their dry runs."""

from drivers.errors import UsageError
from grasp.cli import exits, lab
from grasp.cli.commands import AcquireOptions, LiftOptions, TapOptions, TrialsOptions
from grasp.cli.output import show
from scenarios.campaign.config import RunConfig, load_config, load_lift
from scenarios.rigs.config import HARDWARE, RigConfig

FIRST_OBJECT = "foam"  # with --first, the softest


def run_lift(args: LiftOptions) -> int:
    name, given = args.object, _assignments(args)
    if args.first and args.force is not None:
        problem = "--first closes to the counts of the object's file, and --force by touch"
        raise UsageError(problem, "use one of them")
    if args.first:
        name = FIRST_OBJECT if name is None else name
        config = load_config(name, args.rig, args.detector, args.config, given, args.profile)
        return _run_trials(args, config, name, given)
    if args.force is not None:
        force = f"controller.first_force_n={args.force:g}"
        given = ["controller.first_grasp=touch", *given, force]
    config = load_lift(name, args.rig, args.detector, args.config, given, args.profile)
    if args.force is not None and config.controller.first_grasp != "touch":
        raise UsageError("--force is for a first grasp by touch", "leave out first_grasp=counts")
    return _run_trials(args, config, name or "can", given)


def run_tap(args: TapOptions) -> int:
    given = _assignments(args)
    if args.direction is not None:
        given.append(f"tap.direction={args.direction}")
    config = load_config(args.object, args.rig, args.detector, args.config, given, args.profile)
    return _run_trials(args, config, args.object, given)


def _assignments(args: TrialsOptions) -> list[str]:
    return [*args.set, *(["controller.keep=true"] if args.keep else [])]


def _run_trials(
    args: TrialsOptions, config: RunConfig, object_name: str, assignments: list[str]
) -> int:
    _check_dry(args.dry_run, config)
    from grasp.cli import trials  # the simulation, not before the input is known to be right

    return trials.start(args, config, object_name, assignments)


def _check_dry(dry_run: bool, config: RigConfig) -> None:
    if dry_run and config.rig != HARDWARE:
        problem = f"--dry-run is for real devices, and rig {config.rig} has none"
        raise UsageError(problem, "leave it out, or use --rig hardware")


def run_acquire(args: AcquireOptions) -> int:
    from grasp.cli.live import Display
    from grasp.cli.plans import dry_acquisition, press_plan
    from grasp.cli.trials import is_paced
    from scenarios.acquire import acquire
    from scenarios.acquire.config import load_acquire_config
    from scenarios.acquire.press import motion

    config = load_acquire_config(args.surface, args.rig, args.config, args.set)
    course = motion(args.direction, args.speed, acquire.TURN_RADPS)
    _check_dry(args.dry_run, config)
    if args.dry_run:
        return dry_acquisition(config, course, args)
    permit = lab.permit_run(config, args)
    if permit is not None:
        for line in press_plan(config, course, args.seconds):
            lab.say(f"will {line}")
        lab.warn_of_slow_arm(config)
    with Display(config.rig, quiet=args.json) as display:
        display.setting_up(hand=False)
        done = acquire.run(
            config, course, args.seed, args.seconds, args.runs, is_paced(args), display.sample,
            permit,
        )  # fmt: skip
    if done.failure is None:
        return show(args, done, done.as_text)
    if not args.json:
        print(done.as_text())
    return exits.report_failure(done.failure, args.json, result=done)
