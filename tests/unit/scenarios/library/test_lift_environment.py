"""`grasp/Lift-v0` for training: rewards, options of one episode, pictures, copies."""

import copy
import pickle
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled, ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo

from drivers.errors import BadFile, UsageError
from scenarios.library.lift_environment import LiftEnvironment
from scenarios.report.run_record import read_run
from scenarios.trial.replay import replay_run

CLOSE = np.array([1.0, 1.0, 1.0, 0.0], np.float32)
CLOSE_AND_LIFT = np.ones(4, np.float32)


def played(env: LiftEnvironment, steps: int, lift_at: int) -> tuple[list[float], dict[str, Any]]:
    """Rewards and the last info of an episode that closes, and then lifts."""
    rewards, info = [], env.reset(seed=0)[1]
    for step in range(steps):
        _, reward, dropped, _, info = env.step(CLOSE if step < lift_at else CLOSE_AND_LIFT)
        rewards.append(reward)
        if dropped:
            break
    return rewards, info


def test_success_is_an_object_held_up_within_the_force_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, lifted = played(LiftEnvironment("can", reflex=False), 300, 200)
    assert lifted["is_success"] is True and lifted["peak_force_n"] < 11.0
    assert played(LiftEnvironment("can"), 150, 150)[1]["is_success"] is False
    hand = '[gripper]\ncalibration = "manual"\n[hand]\nleast_force_n = 25.0\n'
    (tmp_path / "hand.toml").write_text(hand, encoding="utf-8")
    monkeypatch.setenv("GRASP_CONFIG", str(tmp_path / "hand.toml"))
    _, pressed = played(LiftEnvironment("can", reflex=False), 300, 200)
    assert pressed["held"] and pressed["peak_force_n"] > 11.0 and not pressed["is_success"]


def test_dense_reward_grows_with_grip_and_height() -> None:
    env = LiftEnvironment("can", reflex=False, reward="dense")
    rewards, info = played(env, 400, 200)
    assert rewards[0] == 0.0
    assert rewards[199] == pytest.approx(0.5, abs=0.05)  # a grip of 5 N or more, on the table
    assert rewards[-1] == pytest.approx(0.5 + 2.0 * info["height_m"] / 0.25, abs=0.05)
    sparse, _ = played(LiftEnvironment("can", reflex=False), 400, 200)
    assert set(sparse) == {0.0, 1.0}


def test_dense_reward_has_no_slip_of_an_object_that_no_finger_touches() -> None:
    env = LiftEnvironment("can", reflex=False, reward="dense")
    env.reset(seed=0)
    steps = [env.step(np.array([-1.0, -1.0, -1.0, 1.0], np.float32)) for _ in range(50)]
    assert steps[-1][4]["slip_m"] > 0.03 and {reward for _, reward, *_ in steps} == {0.0}


@pytest.mark.parametrize("reward", ["sparse", "dense"])
def test_a_drop_ends_the_episode_at_the_same_cost_with_both_rewards(reward: str) -> None:
    env = LiftEnvironment("can", reflex=False, reward=reward)
    played(env, 300, 150)
    for _ in range(100):
        _, got, dropped, _, info = env.step(-CLOSE)
        if dropped:
            break
    assert dropped and got == -100.0 and not info["is_success"]


def test_options_of_reset_hold_for_one_episode() -> None:
    env = LiftEnvironment("can")
    first, _ = env.reset(seed=0)
    other, _ = env.reset(seed=0, options={"object": "ball"})
    again, _ = env.reset(seed=0)
    assert other["fingers"][1] != first["fingers"][1]
    assert {key: value.tolist() for key, value in again.items()} == {
        key: value.tolist() for key, value in first.items()
    }


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"reflex": "no"}, "reflex: 'no' is not True or False"),
        ({"reflex": 1}, "reflex: 1 is not True or False"),
        ({"reward": "shaped"}, "reward: 'shaped' is not 'sparse' or 'dense'"),
        ({"object": 3}, "object: 3 is neither a name nor a path"),
        ({"detector": 5}, "detector: 5 is neither a name nor a path"),
    ],
)
def test_an_option_of_a_wrong_type_is_named(options: dict[str, Any], text: str) -> None:
    env = LiftEnvironment("can")
    for call in (lambda: env.reset(options=options), lambda: LiftEnvironment(**options)):
        with pytest.raises(UsageError) as caught:
            call()
        assert str(caught.value) == text


def test_an_unknown_option_and_options_that_are_no_dict_are_named() -> None:
    env = LiftEnvironment("can")
    with pytest.raises(UsageError, match=r"unknown \['speed'\], known \['object', 'reflex'"):
        env.reset(options={"speed": 1})
    with pytest.raises(UsageError, match=r"options: \['ball'\] is no dict"):
        env.reset(options=["ball"])  # type: ignore[arg-type]


def test_info_holds_plain_values_beside_the_one_documented_object() -> None:
    _, info = LiftEnvironment("can").reset(seed=0)
    admitted = info.pop("admitted")
    assert {type(value) for value in info.values()} == {bool, float}
    assert pickle.loads(pickle.dumps(admitted)) == admitted


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_has_the_same_arguments_and_starts_anew(copied: Any) -> None:
    env = LiftEnvironment("ball", reflex=False, reward="dense")
    first, _ = env.reset(seed=0)
    env.step(CLOSE)
    twin = copied(env)
    with pytest.raises(ResetNeeded, match="call reset first"):
        twin.step(CLOSE)
    again, _ = twin.reset(seed=0)
    assert (again["taxels"] == first["taxels"]).all()


def test_two_environments_at_once_follow_the_vector_api() -> None:
    envs = gymnasium.make_vec("grasp.gym:grasp/Lift-v0", num_envs=2, object="can")
    envs.reset(seed=0)
    obs, rewards, _, _, info = envs.step(np.zeros((2, 4), np.float32))
    assert obs["taxels"].shape == (2, 3, 6) and rewards.shape == (2,)
    assert info["is_success"].tolist() == [False, False]
    envs.close()


def test_render_gives_pictures_only_in_the_mode_rgb_array() -> None:
    assert LiftEnvironment("can").render() is None
    env = LiftEnvironment("can", render_mode="rgb_array")
    with pytest.raises(ResetNeeded):
        env.render()
    env.reset(seed=0)
    before = env.render()
    for _ in range(60):
        env.step(CLOSE)
    after = env.render()
    assert before is not None and after is not None
    assert before.shape == (380, 280, 3) and before.dtype == np.uint8
    assert (before != after).any()  # arrows as long as the forces
    with pytest.raises(UsageError, match="render_mode: 'human' is not None or 'rgb_array'"):
        LiftEnvironment("can", render_mode="human")


def test_missing_matplotlib_is_one_line_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(UsageError, match="pictures need matplotlib") as caught:
        LiftEnvironment("can", render_mode="rgb_array")
    assert "install-exports" in caught.value.remedy and "[exports]" in caught.value.remedy
    env = gymnasium.make("grasp.gym:grasp/Lift-v0")
    check_env(env.unwrapped, skip_render_check=True)


def test_videos_are_recorded_or_refused_by_the_name_of_the_missing_package(tmp_path: Path) -> None:
    env = gymnasium.make("grasp.gym:grasp/Lift-v0", render_mode="rgb_array", max_episode_steps=3)
    try:
        video = RecordVideo(env, str(tmp_path / "video"))
    except DependencyNotInstalled as error:
        assert "moviepy is not installed" in str(error).lower()
        return
    video.reset(seed=0)
    for _ in range(3):
        video.step(CLOSE)
    video.close()
    assert [*(tmp_path / "video").glob("*.mp4")]


def test_an_episode_is_saved_as_a_run_that_can_be_shown_but_not_replayed(tmp_path: Path) -> None:
    env = LiftEnvironment("can", runs=tmp_path)
    _, info = played(env, 300, 150)
    env.reset(seed=1)  # completes the first; the second has no step
    env.close()
    (folder,) = tmp_path.iterdir()
    run = read_run(folder)
    assert run.complete and len(run.t_s) == 300
    assert run.verdict_problem == "An episode of a policy has no verdict."
    assert [change.phase for change in run.phases][:2] == ["grasp.close", "grasp.settle"]
    assert run.truth is not None and run.truth.height_m[-1] == pytest.approx(
        info["height_m"], abs=2e-3
    )
    assert max(sent.message.applied.force_n for sent in run.commands if sent.message.applied) == 10
    with pytest.raises(BadFile, match="an episode of a policy cannot be replayed"):
        replay_run(folder)


def test_a_folder_for_runs_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="runs: 3 is neither"):
        LiftEnvironment("can", runs=3)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="file"):
        LiftEnvironment("can", runs=tmp_path / "file")
