"""Pre-flight checks against a scripted controller: every failure is named, every step ends."""

import time

import pytest

from drivers.checks import failures, raise_failures
from drivers.errors import DeviceFault, LinkLost
from drivers.ur.link.preflight import check_version, preflight
from tests.wire.cases import case
from tests.wire.drivers.ur.link.scripted import DASHBOARD, RTDE, SCRIPT


def failed(report):
    return {check.name for check in failures(report)}


def test_a_fit_controller_passes(controller, host):
    controller()
    report = preflight(host)
    raise_failures(report)
    assert {check.status for check in report} == {"ok"}
    assert "PolyScope 5.11.1.108318" in {check.detail for check in report}


def test_cb3_is_not_checked_for_remote_control(controller, host):
    fake = controller(version=(3, 15, 8, 106339))
    del fake.replies["is in remote control"]
    raise_failures(preflight(host))
    assert "is in remote control" not in fake.commands


@pytest.mark.parametrize("port", [DASHBOARD, SCRIPT, RTDE])
def test_closed_port_is_named(controller, host, port):
    controller(ports={DASHBOARD, SCRIPT, RTDE} - {port})
    report = preflight(host)
    with pytest.raises(LinkLost, match=str(port)):
        raise_failures(report)
    (failure,) = failures(report)
    assert "Services" in failure.remedy and "cable" not in failure.remedy


def test_polyscope_x_is_refused_without_a_hint_at_cables(controller, host):
    controller(version=(10, 11, 0, 0), ports={SCRIPT, RTDE})
    with pytest.raises(DeviceFault, match=r"PolyScope X .* no dashboard server") as caught:
        raise_failures(preflight(host))
    assert "cable" not in caught.value.remedy and "firewall" not in caught.value.remedy


@pytest.mark.parametrize("port", [DASHBOARD, RTDE])
def test_silent_peer_ends_by_the_deadline(controller, host, port):
    controller().speaks.discard(port)
    start = time.monotonic()
    with pytest.raises(LinkLost, match="no reply in time"):
        raise_failures(preflight(host, step_timeout_s=0.3))
    assert time.monotonic() - start < 15  # it ended at all


def test_malformed_replies_on_the_rtde_port(controller, host):
    controller().chatter = b"\x00\x01\x00"
    with pytest.raises(LinkLost, match="no RTDE"):
        raise_failures(preflight(host))


def test_versions_pass_warn_or_fail():
    for version, status in [
        ((3, 2, 0, 0), "fail"),
        ((3, 14, 0, 0), "warn"),
        ((3, 15, 8, 1), "ok"),
        ((5, 0, 0, 0), "fail"),
        ((5, 3, 9, 9), "fail"),
        ((5, 4, 0, 0), "warn"),
        ((5, 5, 0, 0), "ok"),
        ((5, 22, 9, 9), "ok"),
        ((5, 23, 0, 0), "warn"),
        ((10, 10, 0, 0), "fail"),
    ]:
        with case(version, status):
            check = check_version(version)
            assert check.status == status
            assert bool(check.remedy) == (status != "ok")


def test_old_controller_is_refused(controller, host):
    controller(version=(5, 2, 0, 61336))
    with pytest.raises(DeviceFault, match=r"5\.2\.0"):
        raise_failures(preflight(host))


def test_protocol_1_only_is_refused(controller, host):
    controller().accepts_v2 = False
    with pytest.raises(DeviceFault, match="protocol"):
        raise_failures(preflight(host))


def test_local_control_is_refused(controller, host):
    controller().replies["is in remote control"] = "false"
    with pytest.raises(DeviceFault, match="remote control") as caught:
        raise_failures(preflight(host))
    assert "Remote" in caught.value.remedy


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        ("robotmode", "Robotmode: POWER_OFF"),
        ("safetystatus", "Safetystatus: PROTECTIVE_STOP"),
        ("safetystatus", "Safetystatus: ROBOT_EMERGENCY_STOP"),
    ],
)
def test_unfit_robot_and_safety_states_are_refused(controller, host, command, reply):
    controller().replies[command] = reply
    with pytest.raises(DeviceFault, match=reply.split()[1]) as caught:
        raise_failures(preflight(host))
    assert caught.value.remedy


def test_registers_in_use_name_the_fieldbus(controller, host):
    controller().in_use = {f"input_double_register_{i}" for i in range(5)}
    with pytest.raises(DeviceFault, match=r"input_double_register_0.* and 2 more") as caught:
        raise_failures(preflight(host, step_timeout_s=0.3))
    assert "fieldbus" in caught.value.remedy and "URCaps" in caught.value.remedy
    assert "set ur.upper_registers = true" in caught.value.remedy
    raise_failures(preflight(host, upper_registers=True))


def test_the_upper_registers_are_refused_and_not_proposed_from_polyscope_5_23_on(controller, host):
    controller(version=(5, 23, 0, 0)).in_use = {"input_int_register_0"}
    (below,) = failures(preflight(host, 0.3))
    (above,) = failures(preflight(host, 0.3, upper_registers=True))
    assert "upper_registers" not in below.remedy and "upper_registers = false" in above.remedy


def test_claims_of_a_client_that_has_just_disconnected_are_awaited(controller, host):
    fake = controller()
    fake.in_use = {"input_int_register_0"}
    ask, requested = fake.type_of, []

    def freed_at_the_third_look(name):
        requested.append(name)
        if requested.count("input_int_register_0") == 3:
            fake.in_use.clear()
        return ask(name)

    fake.type_of = freed_at_the_third_look
    raise_failures(preflight(host, step_timeout_s=5.0))


def test_a_running_program_is_refused_with_a_remedy(controller, host):
    controller().runtime_states = [2]
    with pytest.raises(DeviceFault, match="a program runs on the arm already") as caught:
        raise_failures(preflight(host, step_timeout_s=0.3))
    assert "`grasp arm stop`" in caught.value.remedy


def test_the_program_of_a_client_that_has_just_disconnected_is_awaited(controller, host):
    controller().runtime_states = [2, 2, 2, 1]
    raise_failures(preflight(host, step_timeout_s=5.0))


@pytest.mark.parametrize(
    ("fraction", "status"),
    [(1.0, "ok"), (0.999, "ok"), (0.98, "warn"), (0.5, "warn"), (0.49, "fail"), (0.0, "fail"),
     (float("nan"), "fail")],
)  # fmt: skip
def test_speed_slider_is_reported_and_refused_below_its_minimum(controller, host, fraction, status):
    controller().speed_fraction = fraction
    report = preflight(host)
    slider = next(check for check in report if check.name == "speed slider")
    assert slider.status == status
    assert bool(slider.remedy) == (status != "ok")
    assert bool(failures(report)) == (status == "fail")


def test_all_failures_are_reported_at_once(controller, host):
    fake = controller()
    fake.replies |= {"is in remote control": "false", "safetystatus": "Safetystatus: VIOLATION"}
    fake.in_use = {"input_int_register_3"}
    report = preflight(host, step_timeout_s=0.3)
    assert failed(report) == {"registers", "remote control", "safety mode"}
    with pytest.raises(DeviceFault) as caught:
        raise_failures(report)
    assert all(check.detail in caught.value.message for check in failures(report))
