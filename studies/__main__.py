"""`python -m studies NAME`: run a study. Without a name, list them."""

import sys
from importlib import import_module
from pkgutil import iter_modules

import studies
from drivers.errors import GraspError
from studies import runner

NOT_STUDIES = ("__main__", "runner", "lift_start", "auxiliary_training")


def names() -> list[str]:
    """All modules that declare a study."""
    found = iter_modules(studies.__path__)
    return [m.name for m in found if not m.ispkg and m.name not in NOT_STUDIES]


def main(words: list[str]) -> int:
    """Returns the exit code: 0 success, 2 usage or another expected error, 130 interrupted."""
    name = words[0] if words else "--help"
    if name not in names():
        print("usage: python -m studies NAME [--help]\n")
        for each in names():
            print(f"  {each:22} {import_module(f'studies.{each}').STUDY.summary}")
        return 0 if name in ("-h", "--help") else 2
    try:
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
    sys.exit(main(sys.argv[1:]))
