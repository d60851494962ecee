"""Driver libraries are imported only when a device is asked for, and missed in clear words."""

from __future__ import annotations

import socket
import subprocess
import sys

import pytest

from hw_adapters.drivers import as7341, ocean, scpi, serial_slider
from hw_adapters.errors import DeviceError, DeviceMissing

OPENERS = {
    "seabreeze.pyseabreeze": lambda: ocean.open_spectrometer(),
    "adafruit_as7341": lambda: as7341.open_as7341(object()),
    "pyvisa": lambda: scpi.open_lights("ASRL1::INSTR", {"panels": 1}),
    "pyvisa_py": lambda: scpi.open_lights("ASRL1::INSTR", {"panels": 1}),
    "serial": lambda: serial_slider.open_slider("COM1", {"out": 0.0}),
}


@pytest.mark.parametrize("module", OPENERS)
def test_a_missing_library_is_answered_with_the_command_that_installs_it(
    module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if module == "pyvisa_py":
        pytest.importorskip("pyvisa", reason="pyvisa is not installed (extra instruments)")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(DeviceMissing) as caught:
        OPENERS[module]()
    assert 'pip install "benchtwin[instruments]"' in str(caught.value)
    assert module.partition(".")[0] in str(caught.value)


def test_importing_the_adapters_imports_no_driver_library() -> None:
    code = (
        "import sys, hw_adapters, hw_adapters.wire.bench, hw_adapters.drivers.ocean\n"
        "import hw_adapters.drivers.as7341, hw_adapters.drivers.scpi\n"
        "import hw_adapters.drivers.serial_slider\n"
        "print(*({'seabreeze', 'usb', 'adafruit_as7341', 'board', 'serial', 'pyvisa'}"
        " & set(sys.modules)))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert result.stdout.strip() == ""


def test_ports_and_resources_that_are_not_there() -> None:
    pytest.importorskip("serial", reason="pyserial is not installed (extra instruments)")
    with pytest.raises(DeviceMissing, match=r"no port .*list_ports"):
        serial_slider.open_slider("/dev/no-such-port", {"out": 0.0})
    pytest.importorskip("pyvisa_py", reason="pyvisa-py is not installed (extra instruments)")
    for resource in ("ASRL/dev/no-such-port::INSTR", "no resource", "ASRLbenchtwin://none::INSTR"):
        with pytest.raises(DeviceMissing, match="nothing at"):
            scpi.open_lights(resource, {"panels": 1})
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(DeviceError, match=r"light supply.*refused"):
        scpi.open_lights(f"TCPIP0::127.0.0.1::{port}::SOCKET", {"panels": 1}, timeout_s=0.1)
