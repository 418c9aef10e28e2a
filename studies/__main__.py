"""`python -m studies NAME`: run a study. Without a name, list them."""

import signal
import sys
from importlib import import_module
from pkgutil import iter_modules

import studies
from drivers.errors import GraspError
from studies import make_results, runner

RESULTS = "results"  # runs studies; none itself
NOT_STUDIES = (
    "__main__", "runner", "auxiliary_training",
    "make_results", "results_detectors", "results_page", "results_run",
)  # fmt: skip


def names() -> list[str]:
    """All modules that declare a study."""
    found = iter_modules(studies.__path__)
    return [m.name for m in found if not (m.ispkg or m.name in NOT_STUDIES)]


def main(words: list[str]) -> int:
    """Returns the exit code: 0 success, 2 usage or another expected error, 130 interrupted."""
    name = words[0] if words else "--help"
    if name not in (*names(), RESULTS):
        print("usage: python -m studies NAME [--help]\n")
        for each in names():
            print(f"  {each:22} {import_module(f'studies.{each}').STUDY.summary}")
        print(f"  {RESULTS:22} {make_results.SUMMARY}")
        return 0 if name in ("-h", "--help") else 2
    try:
        if name == RESULTS:
            return make_results.main(words[1:])
        return runner.main(name, import_module(f"studies.{name}").STUDY, words[1:])
    except GraspError as error:
        print(f"{error.message}; {error.remedy}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(
            "interrupted: stored rows are kept; run the same command to continue", file=sys.stderr
        )
        return 130


if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # a reader such as `head` may end first
    sys.exit(main(sys.argv[1:]))
