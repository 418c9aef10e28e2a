"""What the hash of a trial's settings covers: all that can change a result, nothing else."""

from pathlib import Path

import msgspec

from detector.network_file import weights_path
from scenarios.campaign.config import RunConfig, load_config

COVERED = {
    "rig", "detector_name", "object", "arm", "tactile", "board", "arm_model", "fingertip",
    "gripper", "calibration", "hand", "contact", "variation", "controller", "monitors", "guard",
    "slip", "rule", "energy", "loop", "pull", "damage", "world", "tap",
}  # fmt: skip
LEFT_OUT = {
    "profile",
    "source",
    "devices",  # but their names, of which the defaults have none
    "usb",
    "realtime",
    "psd",
    "psd_fair",
    "network",
    "plugin",
}  # `energy` is asked for


def whole(rig: str = "simulated") -> RunConfig:
    return load_config("can", rig, "energy")


def with_other(config: RunConfig, section: str, key: str) -> RunConfig:
    """With another value of a key, by default the section's last, or of a name."""
    replace = msgspec.structs.replace
    part = getattr(config, section)
    if isinstance(part, str):
        return replace(config, **{section: "psd" if section == "detector_name" else "other"})
    if isinstance(part, dict):
        return replace(config, **{section: {**part, "mine": 1}})
    key = key or part.__struct_fields__[-1]
    value = getattr(part, key)  # what a setting is said to be is not checked here
    if isinstance(value, dict):
        return replace(config, **{section: replace(part, **{key: {**value, "mine": 1}})})
    if section == "board":
        other = value[::-1]  # the configuration counts its cells
    else:
        other = f"{value}!" if isinstance(value, str | tuple | None) else value * 2 + 1
    return replace(config, **{section: replace(part, **{key: other})})


def digests(section: str, key: str = "", rig: str = "simulated") -> set[str]:
    """Of the packaged settings and of those with another value, for lift and tap."""
    plain = whole(rig)
    other = with_other(plain, section, key)
    return {c.digest() for c in (plain.for_lift(), other.for_lift())} | {
        c.digest() for c in (plain.for_tap(), other.for_tap())
    }


def test_what_can_change_a_result_changes_the_hash_and_nothing_else_does() -> None:
    for section in COVERED - {"tap"}:
        assert len(digests(section)) == 4, section
    for section in LEFT_OUT - {"usb"}:
        assert len(digests(section)) == 2, section


def test_no_address_no_name_of_a_file_and_no_text_for_people_is_covered() -> None:
    for key in (
        "modbus.host", "modbus.port", "modbus.serial_port", "modbus.slave",
        "usb.serial", "usb.url", "ur.host", "gripper.calibration", "calibration.name",
        "object.description",
    ):  # fmt: skip
        assert len(digests(*key.split("."), rig="emulated")) == 2, key


def test_the_hash_covers_what_a_weights_file_holds_and_not_its_name(tmp_path: Path) -> None:
    def digest(weights: Path | str) -> str:
        return load_config("can", "simulated", "gru", None, [f"network.weights={weights}"]).digest()

    own = tmp_path / "own.onnx"
    own.write_bytes(weights_path("gru").read_bytes())
    assert digest(own) == digest("gru") == load_config("can", "simulated", "gru").digest()
    before = digest(own)
    own.write_bytes(weights_path("tcn").read_bytes())
    assert digest(own) != before
    assert digest(tmp_path / "none.onnx") not in (before, digest(own))


def test_the_detector_s_hash_covers_weights_and_rule_and_nothing_else() -> None:
    def of(*words: str, object_name: str = "can", detector: str = "gru") -> str:
        return load_config(object_name, "simulated", detector, None, words).detector_hash()

    weights = f"network.weights={weights_path('gru')}"
    assert of() == of(weights) == of("guard.force_limit_n=8", object_name="ball")
    others = {of(), of("rule.threshold=0.4"), of(f"network.weights={weights_path('tcn')}"),
              of(detector="energy"), of("energy.window=9", detector="energy")}  # fmt: skip
    assert len(others) == 5
