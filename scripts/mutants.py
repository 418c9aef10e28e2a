"""Whether the tests see what a wrong sign, threshold or missing line would do: mutation testing.

    python scripts/mutants.py run [--part NAME]       every mutant of what safety rests on
    python scripts/mutants.py sample --seed 17 [--part NAME] [--most 30]
                                                      samples of the rest of grasp/ and drivers/
    python scripts/mutants.py after --seed 17         those of the samples that survived, once more
    python scripts/mutants.py twice [--part NAME] [--most 80]
                                                      some known fates, by a seed, found out again
    python scripts/mutants.py page                    write docs/mutants.md anew

All but the page write what became of each mutant to runs/mutants.json and go on where they stood,
but for files that have changed since; `--anew` forgets that, `--tests` shows others than what is
covered by custom. A mutant that survives needs a test, or an argument why nothing can tell it from
the original: those are in scripts/equivalent_mutants.toml. Exit code 1 if one has neither, or if an
argument is refuted by a test; samples give a rate, and fail if one was not run. What came of a
sample at first, before tests were aimed at it, is found out once: it is told as it is to stand in
scripts/mutant_draws.toml. A seed draws the same of the same code alone. No test may depend on
chance or on the clock here: the same result comes twice.
"""

import argparse
import hashlib
import random
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from drivers.errors import BadFile, GraspError
from grasp.cli.options import whole
from grasp.files import write_whole
from scripts.mutant_parts import MOST_S, PARTS, STRATA, drawn, of_part, of_stratum, tests_of
from scripts.mutant_tables import (
    Draw,
    Told,
    arguments,
    git,
    otherwise,
    still,
    unexplained,
    write_page,
)
from scripts.mutation import HOME, Mutant
from scripts.mutation_run import Fate, run

OUT = Path("runs") / "mutants.json"
TWICE = 80
SAY_S = 30.0  # between two lines of progress
INTERRUPTED = 130


def head() -> str:
    """The commit of the checkout."""
    return git("rev-parse", "--short=7", "HEAD")[:7]


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
        """Fates of all of these, of which those are run that are not among ``fates`` yet, or whose
        file has changed since."""
        known = {fate.mutant: fate for fate in still(fates)}
        said_s = time.monotonic()

        def take(fate: Fate) -> None:
            nonlocal said_s
            known[fate.mutant] = msgspec.structs.replace(fate, shown=shown, commit=commit)
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
