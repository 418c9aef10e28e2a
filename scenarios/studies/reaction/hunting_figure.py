"""The hunting map as a picture. Needs the extra `charts`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grasp.files import save_figure
from scenarios.studies.reaction.hunting import HuntingMap, HuntingSettings

MOST_SHOWN = 20


def draw_hunting(maps: Sequence[HuntingMap], default: HuntingSettings, out: Path) -> None:
    """One panel a policy (rows) and pair of step and hold time (columns); a star: the default."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"
    policies = list(dict.fromkeys(m.policy for m in maps))
    columns = list(dict.fromkeys((m.step_n, m.hold_s) for m in maps))
    figure, axes = plt.subplots(
        len(policies), len(columns), sharex=True, sharey=True, squeeze=False,
        figsize=(2.6 * len(columns) + 1, 2.5 * len(policies) + 0.6), layout="constrained",
    )  # fmt: skip
    for m in maps:
        panel = axes[policies.index(m.policy), columns.index((m.step_n, m.hold_s))]
        image = _draw_panel(panel, m, default)
    for panel, policy in zip(axes[:, 0], policies, strict=True):
        panel.set_ylabel(f"{policy}\nlatency, ms")
    for panel in axes[-1]:
        panel.set_xlabel("refractory time, ms")
    figure.colorbar(image, ax=axes, label=f"compensations in 6 s ({MOST_SHOWN} and more: dark)")
    figure.suptitle("Hold and compensate taking turns (reduced loop); 1 is what a slip deserves")
    save_figure(figure, out, dpi=110)
    plt.close(figure)


def _draw_panel(axes: Any, m: HuntingMap, default: HuntingSettings) -> Any:
    image = axes.pcolormesh(
        [1e3 * r for r in m.refractories_s], [1e3 * latency for latency in m.latencies_s],
        m.compensations, cmap="OrRd", vmin=1, vmax=MOST_SHOWN, shading="nearest", rasterized=True,
    )  # fmt: skip
    axes.plot(
        1e3 * default.refractory_s, 1e3 * default.latency_s, "*", color="#153f6b", ms=11, mec="w"
    )
    bounded = "" if m.bound is None else f"\nat most {m.compensations.max()}, bound {m.bound}"
    axes.set_title(f"step {m.step_n:g} N, hold {m.hold_s * 1e3:.0f} ms{bounded}", fontsize=8)
    return image
