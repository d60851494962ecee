"""Real pyserial and pyvisa-py above the stand-ins that speak in lines."""

from __future__ import annotations

import socket
import threading

import pytest

pytest.importorskip("serial", reason="pyserial is not installed (extra instruments)")
pytest.importorskip("pyvisa", reason="pyvisa is not installed (extra instruments)")
pytest.importorskip("pyvisa_py", reason="pyvisa-py is not installed (extra instruments)")

import pyvisa
import serial

from hw_adapters.wire.links import loopback, serial_port
from hw_adapters.wire.scpi import ScpiSupply
from hw_adapters.wire.slider import BANNER, GrblSlider


def visa(resource: str) -> pyvisa.resources.MessageBasedResource:
    return pyvisa.ResourceManager("@py").open_resource(
        resource, read_termination="\n", write_termination="\n", timeout=100
    )


@pytest.fixture(params=["serial", "socket"])
def supply(request: pytest.FixtureRequest) -> object:
    flowing: dict[int, float] = {}
    device = ScpiSupply(flowing.__setitem__, highest_a=(0.7, 0.35))
    cable = serial_port(device) if request.param == "serial" else loopback(device)
    with cable as address:
        name = f"ASRL{address}::INSTR" if request.param == "serial" else address
        session = visa(name)
        yield session, device, flowing
        session.close()


def test_a_channel_is_set_switched_and_measured(supply: tuple) -> None:
    session, _, flowing = supply
    assert session.query("*IDN?") == "benchtwin,LED-SUPPLY,TWIN0001,1.0"
    session.write("SOURce:CURRent 0.35,(@1)")
    session.write("output:state ON,(@1)")
    assert float(session.query("MEAS:CURR? (@1)")) == 0.35
    assert (session.query("OUTP? (@1)"), session.query("OUTP? (@2)")) == ("1", "0")
    assert flowing[1] == 0.5
    session.write("CURR MAX,(@2)")
    assert float(session.query("CURR? (@2)")) == float(session.query("CURR? MAX,(@2)")) == 0.35
    session.write("*RST")
    assert session.query("SYST:ERR?") == '0,"No error"'
    assert flowing == {1: 0.0, 2: 0.0}


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("VOLT 5,(@1)", "-113"),
        ("CURR 0.1", "-109"),
        ("CURR 0.1,(@3)", "-222"),
        ("CURR 0.8,(@1)", "-222"),
        ("CURR -0.1,(@1)", "-222"),
        ("CURR much,(@1)", "-224"),
        ("OUTP 2,(@1)", "-224"),
    ],
)
def test_a_wrong_line_changes_nothing_and_leaves_an_error(
    supply: tuple, line: str, error: str
) -> None:
    session, device, flowing = supply
    session.write(line)
    assert session.query("SYST:ERR?").startswith(error)
    assert session.query("SYST:ERR?").startswith("0,")
    assert device.refused == [line]
    assert flowing == {}


def test_an_unknown_question_has_no_answer(supply: tuple) -> None:
    session, _, _ = supply
    with pytest.raises(pyvisa.VisaIOError, match="Timeout"):
        session.query("FOO?")
    assert session.query("SYST:ERR?").startswith("-113")


def test_an_unplugged_supply_does_not_answer(supply: tuple) -> None:
    session, device, _ = supply
    device.plugged = False
    with pytest.raises((pyvisa.VisaIOError, OSError)):
        session.query("*IDN?")


def test_the_socket_listens_on_this_computer_only_and_leaves_nothing_running() -> None:
    before = set(threading.enumerate())
    with loopback(ScpiSupply(lambda channel, drive: None)) as resource:
        _, host, port, _ = resource.split("::")
        assert host == "127.0.0.1"
        left_open = socket.create_connection((host, int(port)))
    assert set(threading.enumerate()) == before
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((host, int(port)))
    left_open.close()


def test_what_goes_wrong_inside_the_device_is_raised_by_the_context() -> None:
    def sink(channel: int, drive: float) -> None:
        raise KeyError(f"no lamp at channel {channel}")

    with (
        pytest.raises(KeyError, match="no lamp at channel 1"),
        loopback(ScpiSupply(sink)) as resource,
    ):
        visa(resource).write("OUTP ON,(@1)")


def test_a_port_that_nothing_is_connected_to() -> None:
    with serial_port(ScpiSupply(lambda channel, drive: None)) as url:
        serial.serial_for_url(url).close()
    with pytest.raises(serial.SerialException, match="no such device"):
        serial.serial_for_url(url)


def test_the_slider_is_homed_moved_and_stopped_at_its_end() -> None:
    positions: list[float] = []
    with serial_port(GrblSlider(positions.append, travel_mm=100)) as url:
        port = serial.serial_for_url(url, timeout=1)

        def says(line: bytes) -> list[str]:
            port.write(line)
            return port.read(200).decode().splitlines()

        assert says(b"") == [BANNER]
        assert says(b"?") == ["<Alarm|MPos:0.000,0.000,0.000|FS:0,0>"]
        assert says(b"G0 X10\n") == ["error:9"]
        assert says(b"$H\nG90\n") == ["ok", "ok"]
        assert says(b"G1 X12.5 F600\n?") == ["ok", "<Idle|MPos:12.500,0.000,0.000|FS:0,0>"]
        assert says(b"G0 X100.5\n") == ["error:15"]
        assert says(b"M3 S100\n") == ["error:20"]
    assert positions == [0.0, 12.5]
