"""Expected errors: one line, one remedy, and pickling."""

import pickle

from drivers.errors import (
    BadFile,
    ConfigError,
    CouldNotRecord,
    DeviceFault,
    LinkLost,
    Refused,
    Stale,
    UsageError,
)

PLAIN = (LinkLost, DeviceFault, Refused, Stale, UsageError, CouldNotRecord)


def test_an_error_can_be_pickled() -> None:
    for error in [
        *(kind("what happened", "what to do") for kind in PLAIN),
        BadFile("file.csv", "has no column p5", "another file", 1),
        ConfigError("file.toml", "section.key", "too high", "0 to 1"),
    ]:
        back = pickle.loads(pickle.dumps(error))
        assert type(back) is type(error), error
        assert (str(back), back.message, back.remedy) == (
            str(error),
            error.message,
            error.remedy,
        ), error
        assert "what to do" not in str(back), error
