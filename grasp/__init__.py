"""A grasp controller that feels slip: the application, and a library of six calls.

>>> import grasp
>>> lift = grasp.lift(object="can", seed=0)
>>> lift.result.outcome, lift.t_s.shape, lift.true_force_n.shape

Importing this package imports nothing; the first call imports what it needs. No call moves a real
device: that is what `grasp run --rig hardware` is for.
"""

TYPE_CHECKING = False  # as in typing, which this must not import
if TYPE_CHECKING:
    from scenarios.library.calls import campaign, detector, lift, reflex, replay, tap

__all__ = ["campaign", "detector", "lift", "reflex", "replay", "tap"]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from grasp.files import use_writable_cache

    use_writable_cache()
    from scenarios.library import calls

    return getattr(calls, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
