"""Physics of a scene: contact laws, fingertips, objects. ``cell`` joins them to the devices."""

from pathlib import Path

COMPILING = "compiling the simulation, about a minute, only once"


def is_compiled() -> bool:
    """Whether numba has kept the compiled contact law; otherwise the next run takes longer."""
    if any((Path(__file__).parent / "__pycache__").glob("laws.*.nbi")):
        return True
    from scenarios.world import laws  # noqa: PLC0415  (imports numba, which takes long)

    return any(Path(str(laws.normal_forces.stats.cache_path)).glob("laws.*.nbi"))
