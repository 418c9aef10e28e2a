"""`python -m studies` lists every study and refuses what is none."""

from studies.__main__ import main, names


def test_every_study_is_listed_with_its_summary(capsys) -> None:
    assert main([]) == 0
    listed = capsys.readouterr().out
    assert {"slip_responses", "paper_tables"} <= set(names())
    assert all(f"  {name} " in listed for name in names())


def test_an_unknown_study_is_refused_with_the_list(capsys) -> None:
    assert main(["nosuch"]) == 2
    assert "slip_responses" in capsys.readouterr().out
