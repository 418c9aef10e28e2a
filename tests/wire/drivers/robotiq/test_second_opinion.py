"""The driver against a server that is not ours: pymodbus's own, the modelled hand behind it."""

import asyncio
import threading
import time

import pytest
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.robotiq.driver import DriverSettings, RobotiqDriver
from drivers.robotiq.link.modbus import ModbusSettings, ModbusTransport
from drivers.robotiq.model.gripper import GripperModel
from tests.calibrations import PAPER
from tests.wire.drivers.robotiq.rig import QUICK, TIMEOUT_S, FastClock, until


def device(model: GripperModel, clock: FastClock) -> SimDevice:
    async def action(function, start, address, count, registers, values):
        if function == 16:
            model.write(address, list(values), clock())
        elif function == 4:
            registers[:8] = model.read(clock())
        else:
            return ExcCodes.ILLEGAL_FUNCTION
        return None

    bits = SimData(0, values=[False] * 16, datatype=DataType.BITS)
    words = SimData(0, values=[0] * 8, datatype=DataType.REGISTERS)
    return SimDevice(id=0, simdata=([bits], [bits], [words], [words]), action=action)


@pytest.fixture
def port():
    """A pymodbus server on a free port, in a thread."""
    clock = FastClock(5)
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    async def serve() -> ModbusTcpServer:
        hand = device(GripperModel(QUICK, clock()), clock)
        server = ModbusTcpServer(hand, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        return server

    server = asyncio.run_coroutine_threadsafe(serve(), loop).result(10)
    yield server.transport.sockets[0].getsockname()[1]

    async def end() -> None:
        await server.shutdown()
        await asyncio.sleep(0.05)

    asyncio.run_coroutine_threadsafe(end(), loop).result(10)
    loop.call_soon_threadsafe(loop.stop)
    thread.join(10)
    loop.close()


def test_activate_and_move(port: int) -> None:
    transport = ModbusTransport(ModbusSettings(host="127.0.0.1", port=port, timeout_s=TIMEOUT_S))
    driver = RobotiqDriver(transport, DriverSettings(), PAPER)

    def reach(true) -> None:
        def once() -> bool:
            driver.pump(time.monotonic_ns())
            return true(driver.state)

        until(once)

    reach(lambda state: not state.active)
    driver.activate()
    reach(lambda state: state.active and state.fresh)
    driver.move_to((60, 70, 80), 0.11, 10.0)
    reach(lambda state: state.at_rest)
    assert driver.state.positions == (60, 70, 80)
    transport.close()
