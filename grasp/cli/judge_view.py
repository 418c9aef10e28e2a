"""A data set beside the real clip, as tables."""

from typing import Any

FEW = 20  # pieces, of which 5 % is less than one


def show(judgement: Any) -> None:
    """All that `grasp world calibrate --check --data` says of one part of a data set."""
    from scenarios.studies.signal.judge.verdict import shares_inside

    j = judgement
    print(f"\n{j.part}: {j.pieces} pieces as long as the recording, of {j.recordings} recordings\n")
    if j.pieces < FEW:
        print("few pieces: ranks say little, and the band is from the least to the most")
    print(f"{'statistic':28}{'real':>8}{'5 %':>9}{'median':>9}{'95 %':>9}{'rank %':>8}{'width':>7}")
    for row in j.statistics:
        width = f"{row.width:7.1f}" if row.width is not None else f"{'-':>7}"
        remark = "" if row.inside else "  outside"
        print(
            f"{row.name:28}{row.real:8.3g}{row.low:9.3g}{row.median:9.3g}{row.high:9.3g}"
            f"{row.percentile:8.1f}{width}{remark}{'' if row.narrow else '  wide'}"
        )
    for group, (inside, narrow, of) in shares_inside(j.statistics).items():
        print(f"{group}: {inside} of {of} inside the band of 5 to 95 %, {narrow} of these no wider "
              "than three times the recording's own")  # fmt: skip
    print("\nmedian change of the load from pause to pause, counts: " + ", ".join(
        f"{name} {value:.0f}" for name, value in j.load_changes.items() if value is not None
    ))  # fmt: skip
    print("\ntold apart from the recording (AUC, 95 %; .5: cannot be told)")
    for surfaces, found in j.apart.items():
        if not found:
            print(f"  {surfaces:14}too few strokes, pauses or recordings")
        for a in found:
            middle = a.control[len(a.control) // 2] if a.control else float("nan")
            print(
                f"  {surfaces:14}{a.state:5} {a.auc:.2f} ({a.low:.2f}-{a.high:.2f}) by "
                f"{a.stronger}, {a.real_windows} windows against {a.simulated_windows}; simulated "
                f"pieces in its place {middle:.2f}"
                + (
                    f" ({a.control[0]:.2f}-{a.control[-1]:.2f}), rank {a.rank:.0f} %"
                    if a.control
                    else ""
                )
            )
    print(f"\n{'surface':14}{'mean':>7}{'dev.':>7}{'AUC':>7}{'authors, F1 %':>15}")
    for s in j.surfaces:
        theirs = "-" if s.authors_f1 is None else f"{s.authors_f1:.1f}"
        print(f"{s.surface:14}{s.mean:7.0f}{s.std:7.0f}{s.auc:7.3f}{theirs:>15}")
    for surface, taxels in j.levels.items():
        print(f"\n{surface:14}" + "".join(f"{i:>7}" for i in range(len(taxels))))
        for name, field in (
            ("mean", "mean"), ("authors", "authors_mean"), ("deviation", "std"),
            ("authors", "authors_std"),
        ):  # fmt: skip
            print(f"{name:14}" + "".join(f"{getattr(t, field):7.0f}" for t in taxels))
        loaded = [t for t in taxels if t.loaded]
        print(f"within 1.5 of the authors': {sum(t.near for t in loaded)} of {len(loaded)} taxels")


MOVED = 10.0  # percent: a rank that moves by less is not shown


def show_without(whole: Any, found: list[Any]) -> None:
    """What each term does: ranks of the recording with it and without, and load changes."""
    print(
        f"\n{'left out':38}{'load: all':>10}{'along':>7}  rank of the recording, % (with: without)"
    )
    for made in (whole, *found):
        moved = [
            f"{name} {whole.ranks[name]:.0f}: {rank:.0f}"
            for name, rank in made.ranks.items()
            if name in whole.ranks and abs(rank - whole.ranks[name]) >= MOVED
        ]
        loads = [made.load_changes[key] for key in ("all", "along the finger")]
        cells = ["-" if load is None else f"{load:.0f}" for load in loads]
        print(f"{made.term or 'nothing':38}{cells[0]:>10}{cells[1]:>7}  {', '.join(moved)}")
