"""The comparison of two commits' messages."""

from pathlib import Path

import pytest

from tests.tools.same_messages import differences, record


def test_a_message_that_changed_or_that_one_side_lacks_differs() -> None:
    old = {("/arm", 0): (5, b"a"), ("/arm", 1): (6, b"b"), ("/tap", 0): (7, b"c")}
    assert differences(old, dict(old)) == []
    new = {("/arm", 0): (5, b"a"), ("/arm", 1): (7, b"b"), ("/hand", 0): (7, b"c")}
    assert differences(old, new) == [("/arm", 1), ("/hand", 0), ("/tap", 0)]


def test_outputs_of_the_detector_may_differ_by_what_is_allowed() -> None:
    key = ("/control", 0)
    old, near, far, other = (
        {key: (5, b'{"state":"%s","probabilities":[0.5,%s],"t":1}' % words)}
        for words in ((b"HOLD", b"0.25"), (b"HOLD", b"0.2500004"), (b"HOLD", b"0.26"),
                      (b"LIFT", b"0.25"))
    )  # fmt: skip
    assert differences(old, near) == [key]
    assert differences(old, near, 1e-6) == []
    assert differences(old, far, 1e-6) == differences(old, other, 1e-6) == [key]


def test_a_run_that_leaves_no_message_is_refused(tmp_path: Path) -> None:
    main = tmp_path / "grasp" / "cli" / "main.py"
    main.parent.mkdir(parents=True)
    for folder in (main.parent, main.parents[1]):
        (folder / "__init__.py").touch()
    main.write_text("def main():\n    print('{}')\n    return 1\n")
    with pytest.raises(SystemExit, match="left no message"):
        record(tmp_path, ("lift", "--object", "can"), tmp_path / "runs")
