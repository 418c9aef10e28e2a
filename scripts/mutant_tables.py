"""What became of the mutants, in the tables of docs/mutants.md (scripts/mutants.py)."""

import subprocess
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import cache

import msgspec

from scenarios.campaign.paper import wilson
from scripts.mutant_parts import PARTS, of_part
from scripts.mutation import HOME
from scripts.mutation_run import Fate

PAGE = HOME / "docs" / "mutants.md"
ARGUMENTS = HOME / "scripts" / "equivalent_mutants.toml"
DRAWS = HOME / "scripts" / "mutant_draws.toml"
OPERATORS = "scripts/mutation.py"
BEGINS, ENDS = "<!-- {} by scripts/mutants.py -->", "<!-- end of {} -->"


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


def git(*words: str) -> str:
    """What it says; nothing if it fails, as of a commit that is not there."""
    done = subprocess.run(("git", *words), cwd=HOME, check=False, capture_output=True, text=True)
    return done.stdout if done.returncode == 0 else ""


@cache
def unchanged(path: str, commit: str) -> bool:
    """Whether a file is as it was at a commit."""
    return git("show", f"{commit}:{path}") == (HOME / path).read_text(encoding="utf-8")


def still(fates: Iterable[Fate]) -> list[Fate]:
    """Those of files that are as they were."""
    return [fate for fate in fates if unchanged(fate.mutant.path, fate.commit)]


def table(told: Told, before: str = "") -> str:
    """For the page; of a part that is not known whole, what is, and of one that is not known at all
    its row in the table before, if its files are as they were."""
    if not any(told.parts.get(name) for name in PARTS):
        return ""
    why = arguments()
    columns = ("part", "found out at", "mutants", "run", "killed by a test", "by time-out",
               "equivalent", "survived")  # fmt: skip
    rows = {line.split(" | ")[0].strip("| "): line for line in before.splitlines()}
    paths = ",".join(path for part in PARTS.values() for path in part.paths)
    lines = [entry("mutants", told.commit, paths), *_head(columns)]
    for name, part in PARTS.items():
        there = of_part(part)
        fates = [fate for fate in still(told.parts.get(name, [])) if fate.mutant in set(there)]
        if not fates and name in rows:
            commits = rows[name].split(" | ")[1].split(", ")
            if all(unchanged(path, commit) for path in part.paths for commit in commits):
                lines.append(rows[name])
                continue
        kinds = Counter(_kind(fate, why) for fate in fates)
        row = [kinds[kind] for kind in ("killed", "time-out", "equivalent", "survived")]
        at = ", ".join(sorted({fate.commit for fate in fates})) or "-"
        lines.append(_row(name, at, len(there), len(fates), *row))
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
    before = page.partition(BEGINS.format("parts"))[2].partition(ENDS.format("parts"))[0]
    texts = {"parts": table(told, before), "samples": of_draws(draws()), "twice": of_twice(told)}
    for name, text in texts.items():
        before, begins, rest = page.partition(BEGINS.format(name))
        _, ends, after = rest.partition(ENDS.format(name))
        if text:
            page = f"{before}{begins}\n\n{text}\n\n{ends}{after}"
    PAGE.write_text(page, encoding="utf-8")
