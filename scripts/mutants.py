"""Whether the tests see what a wrong sign, threshold or missing line would do: mutation testing.

    python scripts/mutants.py run [--part NAME]       every mutant of what safety rests on
    python scripts/mutants.py sample --seed 17 [--part NAME] [--most 30]
                                                      samples of the rest of grasp/ and drivers/
    python scripts/mutants.py after --seed 17         those of the samples that survived, once more
    python scripts/mutants.py twice [--part NAME] [--most 80]
                                                      some known fates, by a seed, found out again
    python scripts/mutants.py page                    write docs/mutants.md anew

All but the page write what became of each mutant to runs/mutants.json and go on where they stood;
`--anew` forgets that, `--tests` shows others than what is covered by custom. A mutant that survives
needs a test, or an argument why nothing can tell it from the original: those are in
scripts/equivalent_mutants.toml. Exit code 1 if one has neither, or if an argument is refuted by a
test; samples give a rate, and fail if one was not run. What came of a sample at first, before tests
were aimed at it, is found out once: it is told as it is to stand in scripts/mutant_draws.toml. A
seed draws the same of the same code alone. No test may depend on chance or on the clock here: the
same result comes twice.
"""

import argparse
import hashlib
import random
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from drivers.errors import BadFile, GraspError
from grasp.cli.options import whole
from grasp.files import write_whole
from scenarios.campaign.paper import wilson
from scripts.mutation import HOME, Mutant, mutants
from scripts.mutation_run import Fate, run

PAGE = HOME / "docs" / "mutants.md"
ARGUMENTS = HOME / "scripts" / "equivalent_mutants.toml"
DRAWS = HOME / "scripts" / "mutant_draws.toml"
OPERATORS = "scripts/mutation.py"
OUT = Path("runs") / "mutants.json"
BEGINS, ENDS = "<!-- {} by scripts/mutants.py -->", "<!-- end of {} -->"
TWICE = 80
SAY_S = 30.0  # between two lines of progress
INTERRUPTED = 130
MOST_S = 30.0  # of tests that a mutant is shown; those that have killed its kin go first

UNIT = "tests/unit"
ROBOTIQ = tuple(f"{UNIT}/drivers/robotiq/test_{name}.py" for name in (
    "calibration", "driver_contact", "driver_faults", "driver_verbs", "exchange", "protocol",
    "registers",
))  # fmt: skip
GRASP = f"{UNIT}/grasp"


class Part(msgspec.Struct, frozen=True):
    """Modules, and the tests that cover them."""

    paths: tuple[str, ...]
    tests: tuple[str, ...]


PARTS = {
    "guard": Part(("grasp/guard.py",), (f"{GRASP}/test_guard.py", f"{GRASP}/test_step.py")),
    "step": Part(("grasp/step.py",), (f"{GRASP}/test_step.py",)),
    "rule": Part(
        ("detector/decision.py",),
        (f"{UNIT}/detector/test_decision.py", f"{UNIT}/detector/scores/test_sweep.py"),
    ),
    "safe-states": Part(
        ("grasp/safe_state.py",),
        (f"{GRASP}/test_safe_state.py", f"{GRASP}/test_controller_safe_states.py"),
    ),
    "gripper": Part(
        tuple(f"drivers/robotiq/{name}.py" for name in (
            "driver", "exchange", "encoding", "calibration", "protocol",
        )),
        ROBOTIQ,
    ),
    "closings": Part(
        ("grasp/closing.py", "grasp/steps.py", "grasp/stiffness.py"),
        tuple(f"{GRASP}/test_{name}.py" for name in (
            "closing", "steps", "stiffness", "controller_slip", "pause",
            "controller_safe_states",
        )),
    ),
    "gripper-doubt": Part(
        ("grasp/gripper_doubt.py",), (f"{GRASP}/test_gripper_doubt.py", f"{GRASP}/test_doubt.py")
    ),
    "gripper-link": Part(
        tuple(f"drivers/robotiq/link/{name}.py" for name in ("modbus", "thread", "timing")),
        (f"{UNIT}/drivers/robotiq/test_link_*.py", *(
            f"tests/wire/drivers/robotiq/{name}.py" for name in (
                "link/test_thread", "test_driver", "emulator/test_rtu",
            )
        )),
    ),
    "loop": Part(
        ("grasp/loop.py", "grasp/commands.py"),
        (f"{GRASP}/test_loop_alone.py", f"{GRASP}/test_loop.py"),
    ),
}  # fmt: skip


class Stratum(msgspec.Struct, frozen=True):
    """A sample: modules by what is in their paths, how many mutants, and the tests they are shown,
    so much of them each."""

    words: tuple[str, ...]
    mutants: int
    tests: tuple[str, ...]
    most_s: float = MOST_S


SAMPLED = ("grasp", "drivers")
STRATA = {
    "command-line": Stratum(
        ("grasp/cli/",), 30, (f"{GRASP}/cli", f"{GRASP}/test_watch.py"), most_s=15.0
    ),
    "wires": Stratum(
        ("/emulator/", "/link/"), 40, (f"{UNIT}/drivers", "tests/wire/drivers"), most_s=15.0
    ),
    "rest": Stratum(
        ("",), 300, (f"{UNIT}/drivers", f"{UNIT}/test_safety_settings.py", f"{GRASP}/test_*.py")
    ),
}  # fmt: skip


class Argument(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Why nothing can tell these mutants from the original."""

    mutants: list[str]
    why: str


class Draw(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What came of a sample at first, of how many mutants in all; and of its survivors since."""

    stratum: str
    seed: int
    commit: str
    of: int
    mutants: int
    equivalent: int
    killed: int
    since: int = 0  # killed by tests written since

    @property
    def real(self) -> int:
        return self.mutants - self.equivalent

    @property
    def rate(self) -> tuple[float, float, float]:
        """Killed at first of those that are not equivalent, and the interval."""
        return self.killed / self.real, *wilson(self.killed, self.real)


class Told(msgspec.Struct):
    """What became of the mutants of all parts and samples, and the commit of the latest;
    ``twice``: of some, the second time."""

    parts: dict[str, list[Fate]] = {}
    commit: str = "0000000"
    seed: int = 0  # of the samples
    twice: dict[str, list[Fate]] = {}


def arguments() -> dict[str, str]:
    """By mutant, as its name is written."""
    text = ARGUMENTS.read_text(encoding="utf-8")
    found = msgspec.toml.decode(text, type=dict[str, list[Argument]])
    return {name: one.why for one in found["argument"] for name in one.mutants}


def draws() -> list[Draw]:
    text = DRAWS.read_text(encoding="utf-8")
    return msgspec.toml.decode(text, type=dict[str, list[Draw]])["draw"]


def head() -> str:
    """The commit of the checkout."""
    command = ("git", "rev-parse", "--short=7", "HEAD")
    return subprocess.run(command, cwd=HOME, check=True, capture_output=True, text=True).stdout[:7]


def of_part(part: Part) -> list[Mutant]:
    return [mutant for path in part.paths for mutant in mutants(path)]


def of_stratum(name: str) -> list[Mutant]:
    """Of all modules that are of no part and of no stratum before it."""
    theirs = {path for part in PARTS.values() for path in part.paths}
    paths = sorted(
        str(path.relative_to(HOME)) for top in SAMPLED for path in (HOME / top).rglob("*.py")
    )
    return [
        mutant for path in paths
        if path not in theirs and _stratum(path) == name for mutant in mutants(path)
    ]  # fmt: skip


def _stratum(path: str) -> str:
    return next(name for name, one in STRATA.items() if any(word in path for word in one.words))


def drawn(name: str, seed: int) -> list[Mutant]:
    """A sample, in the order in which the seed draws it."""
    return random.Random(seed).sample(of_stratum(name), STRATA[name].mutants)


def unexplained(fates: Iterable[Fate], why: dict[str, str]) -> list[str]:
    """Survivors without an argument, and arguments that a test refutes."""
    found = []
    for fate in fates:
        name = str(fate.mutant)
        if not fate.killer and name not in why:
            found.append(f"survived: {name} (seen by {fate.tests} tests)")
        if fate.killer and name in why:
            found.append(f"said to be equivalent, and killed by {fate.killer}: {name}")
    return found


class Book:
    """What is known, kept after each mutant."""

    def __init__(
        self, out: Path, anew: bool = False, tests: Sequence[str] | None = None, begins: bool = True
    ) -> None:
        """``begins``: there need be none yet. Raises BadFile."""
        self._out, self.tests = out, tests
        self.told = Told()
        if anew or (begins and not out.exists()):
            return
        try:
            self.told = msgspec.json.decode(out.read_bytes(), type=Told)
        except OSError as error:
            raise BadFile(out, f"{error.strerror}", "make it first: mutants.py run") from None
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise BadFile(out, f"{error}", "name another with --out, or begin --anew") from None

    def kept(self) -> str:
        """In a line."""
        fates = sum(map(len, (*self.told.parts.values(), *self.told.twice.values())))
        return f"{fates} fates kept in {self._out}; the same command goes on"

    def attack(self, name: str, fates: list[Fate], chosen: Sequence[Mutant]) -> list[Fate]:
        """Fates of all of these, of which those are run that are not among ``fates`` yet."""
        known = {fate.mutant: fate for fate in fates}
        said_s = time.monotonic()

        def take(fate: Fate) -> None:
            nonlocal said_s
            known[fate.mutant] = msgspec.structs.replace(fate, shown=shown)
            self.told.commit = commit
            fates[:] = [known[m] for m in chosen if m in known]
            self._out.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._out, msgspec.json.encode(self.told))
            if time.monotonic() - said_s > SAY_S or len(fates) == len(chosen):
                said_s = time.monotonic()
                print(f"{name}: {progress(fates, len(chosen))}", flush=True)

        commit, shown = head(), digest(self.tests or tests_of(name))
        lacking = [mutant for mutant in chosen if mutant not in known]
        print(f"{name}: {len(lacking)} of {len(chosen)} mutants to run", flush=True)
        if lacking:
            most_s = STRATA[name].most_s if name in STRATA else MOST_S
            run(self.tests or tests_of(name), lacking, most_s, take)
        return [known[mutant] for mutant in chosen if mutant in known]


def progress(fates: Sequence[Fate], of: int) -> str:
    """How many of all, and what became of them."""
    killed = sum(bool(fate.killer) for fate in fates)
    return f"{len(fates)} of {of} mutants: {killed} killed, {len(fates) - killed} survived"


def digest(tests: Sequence[str]) -> str:
    """Of tests as they are now, with the helpers beside and above them."""
    files = {path for test in tests for path in (HOME / test, *(HOME / test).rglob("*.py"))}
    folders = {folder for path in files for folder in path.parents if HOME in folder.parents}
    files |= {path for at in folders for path in at.glob("*.py") if "test_" not in path.name}
    there = sorted(path for path in files if path.is_file())
    return hashlib.sha256(b"".join(path.read_bytes() for path in there)).hexdigest()[:12]


def run_parts(book: Book, names: Sequence[str]) -> int:
    why, found = arguments(), []
    for name in names:
        chosen = of_part(PARTS[name])
        fates = book.attack(name, book.told.parts.setdefault(name, []), chosen)
        if len(fates) < len(chosen):
            found.append(f"{name}: {len(chosen) - len(fates)} mutants were not run")
        found += unexplained(fates, why)
    print("\n".join(found) or "every mutant is killed or shown to be equivalent")
    return 1 if found else 0


def tests_of(name: str) -> list[str]:
    """That are shown the mutants of a part or a stratum."""
    tests = PARTS[name].tests if name in PARTS else STRATA[name].tests
    return [str(path.relative_to(HOME)) for test in tests for path in sorted(HOME.glob(test))]


def run_samples(book: Book, names: Sequence[str], seed: int, most: int | None) -> int:
    """They give a rate, so one that survives is no failure; one that was not run is."""
    why, lacking = arguments(), 0
    if book.told.seed != seed:
        book.told.parts = {n: fates for n, fates in book.told.parts.items() if n not in STRATA}
        book.told.seed = seed
    for name in names:
        chosen = drawn(name, seed)[:most]
        fates = book.attack(name, book.told.parts.setdefault(name, []), chosen)
        lacking += len(chosen) - len(fates)
        print("\n".join(unexplained(fates, why)))
        killed = sum(bool(fate.killer) for fate in fates)
        equivalent = sum(str(fate.mutant) in why for fate in fates)
        draw = Draw(name, seed, head(), len(of_stratum(name)), len(fates), equivalent, killed)
        fields = msgspec.structs.asdict(draw).items()
        print(
            "[[draw]]",
            *(f"{key} = {msgspec.json.encode(v).decode()}" for key, v in fields),
            sep="\n",
        )
    return 1 if lacking else 0


def run_after(book: Book, names: Sequence[str], seed: int) -> int:
    """Those once more that survived."""
    for name in names:
        fates = book.told.parts.get(name, [])
        fates[:] = [fate for fate in fates if fate.killer]
    lacking = run_samples(book, names, seed, None)
    left = unexplained((fate for name in names for fate in book.told.parts[name]), arguments())
    return 1 if left else lacking


def run_twice(book: Book, names: Sequence[str], most: int) -> int:
    """Some of each part once more: whether a test sees them is to be the same. Those are left out
    whose tests have changed since: a test that was written meanwhile is no chance."""
    found = []
    for name in names:
        now = digest(book.tests or tests_of(name))
        first = [fate for fate in book.told.parts[name] if fate.shown == now]
        chosen = random.Random(book.told.seed).sample(first, min(most, len(first)))
        again = book.told.twice.setdefault(name, [])
        book.attack(name, again, [fate.mutant for fate in chosen])
        found += otherwise(first, again)
    print("\n".join(found) or "the same")
    return 1 if found else 0


def otherwise(first: Iterable[Fate], again: Iterable[Fate]) -> list[str]:
    """Mutants that one time a test saw and the other time none of the same tests did."""
    known = {fate.mutant: fate for fate in first}
    pairs = [(known[fate.mutant], fate) for fate in again]
    pairs = [(a, b) for a, b in pairs if a.shown == b.shown]
    words = {False: "survived", True: "killed"}
    return [
        f"{a.mutant}: {words[bool(a.killer)]}, then {words[bool(b.killer)]}"
        for a, b in pairs if bool(a.killer) != bool(b.killer)
    ]  # fmt: skip


def table(told: Told) -> str:
    """For the page; of a part that is not known whole, what is."""
    if not any(told.parts.get(name) for name in PARTS):
        return ""
    why = arguments()
    columns = ("part", "mutants", "run", "killed by a test", "by time-out", "equivalent",
               "survived")  # fmt: skip
    paths = ",".join(path for part in PARTS.values() for path in part.paths)
    lines = [entry("mutants", told.commit, paths), *_head(columns)]
    for name, part in PARTS.items():
        there = of_part(part)
        fates = [fate for fate in told.parts.get(name, []) if fate.mutant in set(there)]
        kinds = Counter(_kind(fate, why) for fate in fates)
        row = [kinds[kind] for kind in ("killed", "time-out", "equivalent", "survived")]
        lines.append(_row(name, len(there), len(fates), *row))
    return "\n".join(lines)


def entry(name: str, commit: str, code: str) -> str:
    """Above a table: what it rests on."""
    return f'<!-- figure: id={name} command="make mutants" commit={commit} code={code} -->'


def _head(columns: Sequence[str]) -> list[str]:
    return [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]


def _row(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def _kind(fate: Fate, why: dict[str, str]) -> str:
    if fate.killer:
        return "time-out" if fate.killer == "time-out" else "killed"
    return "equivalent" if str(fate.mutant) in why else "survived"


def of_draws(known: Sequence[Draw]) -> str:
    """What samples told at first, and all strata together."""
    columns = ("drawn of", "seed", "commit", "mutants of all", "equivalent", "killed at first",
               "% (95 %)", "killed since", "survive")  # fmt: skip
    lines = [entry("mutants-sampled", known[0].commit, OPERATORS),
             *_head(columns)]  # fmt: skip
    for d in known:
        rest = d.real - d.killed - d.since
        cells = (
            f"{d.mutants} of {d.of}",
            d.equivalent,
            f"{d.killed} of {d.real}",
            _percent(d.rate),
        )
        lines.append(_row(d.stratum, d.seed, d.commit, *cells, d.since, rest))
    latest = {draw.stratum: draw for draw in known}
    return "\n".join([*lines, "", f"{', '.join(latest)}, each by its number of mutants: "
                      f"{_percent(together(list(latest.values())))}."])  # fmt: skip


def together(known: Sequence[Draw]) -> tuple[float, float, float]:
    """The rate of all strata and its interval, from theirs (the square-and-add rule of MOVER)."""
    of = sum(draw.of for draw in known)
    each = [(draw.of / of, *draw.rate) for draw in known]
    rate = sum(weight * middle for weight, middle, _, _ in each)
    below = sum((weight * (middle - low)) ** 2 for weight, middle, low, _ in each) ** 0.5
    above = sum((weight * (high - middle)) ** 2 for weight, middle, _, high in each) ** 0.5
    return rate, rate - below, rate + above


def _percent(rate: tuple[float, float, float]) -> str:
    return "{:.0f} ({:.0f} to {:.0f})".format(*(100 * part for part in rate))


def of_twice(told: Told) -> str:
    if not told.twice:
        return ""
    columns = ("found out twice", "mutants", "the same", "by the same test")
    lines = [
        entry("mutants-twice", told.commit, f"{OPERATORS},scripts/mutation_run.py"),
        *_head(columns),
    ]
    differ = []
    for name, again in told.twice.items():
        first = {fate.mutant: fate for fate in told.parts[name]}
        other = otherwise(first.values(), again)
        differ += other
        by_same = sum(first[fate.mutant].killer == fate.killer for fate in again)
        lines.append(_row(name, len(again), len(again) - len(other), by_same))
    return "\n".join([*lines, *("" for _ in differ[:1]), *(f"- `{text}`" for text in differ)])


def write_page(told: Told) -> None:
    """Each table anew of which all is known."""
    page = PAGE.read_text(encoding="utf-8")
    texts = {"parts": table(told), "samples": of_draws(draws()), "twice": of_twice(told)}
    for name, text in texts.items():
        before, begins, rest = page.partition(BEGINS.format(name))
        _, ends, after = rest.partition(ENDS.format(name))
        if text:
            page = f"{before}{begins}\n\n{text}\n\n{ends}{after}"
    PAGE.write_text(page, encoding="utf-8")


VERBS = {
    "run": "every mutant of what safety rests on; exit code 1 if one survives without an argument",
    "sample": "samples of the rest of grasp/ and drivers/, for a rate",
    "after": "those of the samples that survived, once more, with tests written since",
    "twice": "some known fates, by the samples' seed, found out again",
    "page": "write docs/mutants.md anew from the fates there are",
}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    for verb, what in VERBS.items():
        words = verbs.add_parser(verb, help=what, description=what)
        words.add_argument(
            "--out", type=Path, default=OUT, help="file of the fates (default: %(default)s)"
        )
        if verb == "page":
            continue
        parts = {"run": (*PARTS,), "twice": (*PARTS, *STRATA)}.get(verb, (*STRATA,))
        words.add_argument(
            "--part", choices=parts, action="append", help="this alone; may be given several times"
        )
        words.add_argument(
            "--tests", action="append", metavar="PATH",
            help="tests to be shown, in place of those that cover it; may be given several times",
        )  # fmt: skip
        if verb in ("sample", "twice"):
            words.add_argument(
                "--most", type=whole(1, 1_000_000), metavar="N",
                help="the first N drawn of each part (default: "
                f"{TWICE if verb == 'twice' else 'all'})",
            )  # fmt: skip
        if verb in ("sample", "after"):
            words.add_argument(
                "--seed", type=whole(0, 2**63 - 1), default=0,
                help="draws them, of the same code the same (default: %(default)s); another "
                "forgets the samples that are known",
            )  # fmt: skip
        if verb in ("run", "sample"):
            words.add_argument(
                "--anew", action="store_true", help="forget all fates that are in the file"
            )
    return parser


def main() -> int:
    asked = _parser().parse_args()
    try:
        begins = asked.verb in ("run", "sample")
        book = Book(asked.out, getattr(asked, "anew", False), getattr(asked, "tests", None), begins)
    except GraspError as error:
        print(f"mutants: {error} ({error.remedy})", file=sys.stderr)
        return 2
    try:
        return do(asked, book)
    except KeyboardInterrupt:
        print(f"mutants: {book.kept()}", file=sys.stderr)
        return INTERRUPTED


def do(asked: argparse.Namespace, book: Book) -> int:
    """Exit code."""
    if asked.verb == "run":
        return run_parts(book, asked.part or list(PARTS))
    if asked.verb == "sample":
        return run_samples(book, asked.part or list(STRATA), asked.seed, asked.most)
    if asked.verb == "after":
        return run_after(book, asked.part or list(STRATA), asked.seed)
    if asked.verb == "twice":
        return run_twice(book, asked.part or [*book.told.parts], asked.most or TWICE)
    write_page(book.told)
    return 0


if __name__ == "__main__":
    sys.exit(main())
