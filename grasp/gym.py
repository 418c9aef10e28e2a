"""Importing this module registers the gymnasium environment `grasp/Lift-v0`, which needs the extra
`gym`. gymnasium 1.0 and later read no entry points, so `import gymnasium` alone cannot do it."""

try:
    from gymnasium import register
except ImportError:
    text = "gymnasium is missing: make install-gym, or pip install 'grasp-controller[gym]'"
    raise ImportError(text) from None

register(
    "grasp/Lift-v0", "scenarios.library.lift_environment:LiftEnvironment", max_episode_steps=600
)
