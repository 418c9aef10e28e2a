"""Scenarios for real ur_rtde: ``python clients.py scenario host fault_port``."""

import faulthandler
import json
import math
import os
import socket
import sys
import threading
import time

import dashboard_client
import rtde_control
import rtde_io
import rtde_receive

WAIT_S = 60.0


class Site:
    """An emulator and ur_rtde's interfaces to it."""

    def __init__(self, host, fault_port):
        self.host = host
        self.faults = (host, fault_port)
        self.receive = rtde_receive.RTDEReceiveInterface(host)
        self.control = None

    def connect(self):
        self.control = rtde_control.RTDEControlInterface(self.host)
        return self.control

    def fault(self, **request):
        with socket.create_connection(self.faults, timeout=10) as sock, sock.makefile("rw") as f:
            f.write(json.dumps(request) + "\n")
            f.flush()
            reply = json.loads(f.readline())
        assert reply["ok"], reply
        return reply

    @property
    def position(self):
        return self.receive.getActualTCPPose()[:3]

    @property
    def speed(self):
        return math.hypot(*self.receive.getActualTCPSpeed()[:3])

    def target(self, dx=0.0, dy=0.0, dz=0.0):
        x, y, z, *turn = self.receive.getActualTCPPose()
        return [x + dx, y + dy, z + dz, *turn]


def until(condition, what):
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.005)


def near(a, b, tolerance=1e-6):
    return math.dist(a, b) <= tolerance


def fields(site):
    r = site.receive
    assert near(site.position, (0.5, 0.1, 0.3))
    assert r.getRobotMode() == 7 and r.getSafetyMode() == 1
    assert not r.isProtectiveStopped() and not r.isEmergencyStopped()
    assert r.getSafetyStatusBits() == 1 and r.getRobotStatus() & 1
    first = r.getTimestamp()
    until(lambda: r.getTimestamp() > first, "timestamps stand still")
    cycles = (r.getTimestamp() - first) / 0.008
    assert abs(cycles - round(cycles)) < 1e-6


def connect(site):
    assert site.connect().isProgramRunning()


def move_l(site):
    c = site.connect()
    start = site.target()
    target = site.target(dx=0.03, dy=-0.05, dz=0.08)
    before = site.receive.getActualQ()
    assert c.moveL(target, 0.25, 1.2)
    until(lambda: near(site.position, target[:3]), "not at the target")
    assert not near(site.receive.getActualQ(), before, 0.01)
    # joints and tool agree, as unmodified clients read them
    assert near(c.getForwardKinematics()[:3], target[:3])
    longer = c.getForwardKinematics(site.receive.getActualQ(), [0.0, 0.0, 0.01, 0.0, 0.0, 0.0])
    assert near(longer[:3], [*target[:2], target[2] - 0.01])
    assert c.getInverseKinematics(start)
    assert c.moveL(start, 0.25, 1.2)
    until(lambda: near(site.position, start[:3]), "not back")


def path_and_custom_script(site):
    """Both upload the control script again, with more text in it."""
    c = site.connect()
    last = site.target(dy=0.02)
    assert c.moveL([[*site.target(dz=0.02), 0.2, 0.5, 0.0], [*last, 0.2, 0.5, 0.0]])
    until(lambda: near(site.position, last[:3]), "not at the end of the path")
    assert c.sendCustomScriptFunction("greet", 'x = 1 + 2\ntextmsg("greeting ", x)\n')
    until(c.isProgramRunning, "the control script does not run again")
    assert any("greeting 3" in line for line in site.fault(do="state")["messages"])


def settings(site):
    c = site.connect()
    assert c.setPayload(1.5, [0.0, 0.0, 0.05])
    until(lambda: site.receive.getPayload() == 1.5, "payload not taken")
    assert c.setTcp([0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    until(lambda: near(site.position, (0.5, 0.1, 0.2)), "tool centre point not taken")
    assert near(c.getTCPOffset(), (0.0, 0.0, 0.1, 0.0, 0.0, 0.0))
    target = site.target(dx=-0.02)
    assert c.moveL(target, 0.25, 1.2)
    until(lambda: near(site.position, target[:3]), "not at the target")
    assert c.isPoseWithinSafetyLimits(target)
    assert not c.isPoseWithinSafetyLimits(site.target(dx=3.0))


def protective_stop(site):
    c = site.connect()
    results = []
    target = site.target(dz=0.3)
    mover = threading.Thread(target=lambda: results.append(c.moveL(target, 0.05, 0.5)))
    mover.start()
    until(lambda: site.speed > 0.01, "does not move")
    site.fault(do="protective_stop")
    mover.join(WAIT_S)
    assert results == [False]
    # the other interface has its own connection, and therefore its own delay
    until(site.receive.isProtectiveStopped, "no protective stop")
    until(lambda: site.receive.getSafetyMode() == 3, "no safety mode")
    until(lambda: site.speed == 0.0, "moves on")
    assert not c.moveL(target, 0.05, 0.5)
    dashboard = dashboard_client.DashboardClient(site.host)
    dashboard.connect()
    assert "PROTECTIVE_STOP" in dashboard.safetystatus()
    dashboard.unlockProtectiveStop()
    until(lambda: not site.receive.isProtectiveStopped(), "not unlocked")
    recovered(site, c)


def recovered(site, c):
    assert c.reuploadScript()
    until(c.isProgramRunning, "program does not start again")
    assert c.moveL(site.target(dz=-0.02), 0.25, 1.2)


def stop_after_speed(site):
    """Known limitation of ur_rtde: two threads of its script want the arm, the controller ends
    it."""
    c = site.connect()
    assert c.speedL([0.0, 0.0, 0.02, 0.0, 0.0, 0.0], 0.5)
    until(lambda: site.speed > 0.01, "does not move")
    c.stopL(1.0)
    until(lambda: not c.isProgramRunning(), "the program goes on")
    until(lambda: site.speed == 0.0, "moves without a program")
    messages = " ".join(site.fault(do="state")["messages"])
    assert "Another thread is already controlling the robot" in messages


def io(site):
    r = site.receive
    outputs = rtde_io.RTDEIOInterface(site.host)
    assert outputs.setSpeedSlider(0.5)
    until(lambda: r.getTargetSpeedFraction() == 0.5, "speed slider not set")
    assert outputs.setInputIntRegister(20, 7)
    outputs.disconnect()


def dashboard(site):
    d = dashboard_client.DashboardClient(site.host)
    d.connect()
    d.powerOff()
    until(lambda: site.receive.getRobotMode() == 3, "not off")
    assert "POWER_OFF" in d.robotmode()
    d.powerOn()
    d.brakeRelease()
    until(lambda: site.receive.getRobotMode() == 7, "not running")
    assert site.receive.getSafetyMode() == 1
    site.connect()
    until(d.running, "does not play")
    d.stop()
    until(lambda: not d.running(), "does not stop")
    d.closeSafetyPopup()


def not_remote(site):
    site.fault(do="remote_control", on=False)
    try:
        site.connect()
    except RuntimeError as error:
        assert "remote control" in str(error), error
    else:
        raise AssertionError("connected")


def in_use(site):
    site.fault(do="claim", names=["input_int_register_0"])
    try:
        site.connect()
    except RuntimeError as error:
        assert "already in use" in str(error), error
    else:
        raise AssertionError("connected")
    site.fault(do="unclaim")
    site.connect()


def main(scenario, host, fault_port):
    faulthandler.dump_traceback_later(170, exit=True)
    site = Site(host, int(fault_port))
    globals()[scenario](site)
    if site.control is not None:
        site.control.disconnect()
    site.receive.disconnect()
    sys.stdout.flush()
    os._exit(0)  # ur_rtde's destructors wait, and can crash


if __name__ == "__main__":
    main(*sys.argv[1:])
