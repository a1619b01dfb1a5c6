"""Graphics that are there and unused: the system's files of real machines, and what the doctor finds."""

from pathlib import Path

import pytest

from recorder.doctor import _gpu, _gpus

H200 = "Model: \t\t NVIDIA H200\nIRQ:   \t\t 41\nVideo BIOS: \t 96.00.a5.00.1a\nBus Type: \t PCIe\n"
MACHINES: dict[str, tuple[dict[str, str], list[str]]] = {
    "none": ({}, []),
    "container": (
        {"proc/driver/nvidia/gpus/0000:00:06.0/information": H200, "dev/nvidia0": ""},
        ["NVIDIA H200"],
    ),
    "sandbox": ({"dev/nvidia0": "", "dev/nvidia1": "", "dev/nvidiactl": ""}, ["NVIDIA", "NVIDIA"]),
    "laptop": (
        {
            "proc/driver/nvidia/gpus/0000:01:00.0/information": "Model: \t NVIDIA RTX A2000\n",
            "sys/class/drm/renderD128/device/vendor": "0x8086\n",
            "sys/class/drm/renderD129/device/vendor": "0x10de\n",
        },
        ["NVIDIA RTX A2000", "Intel"],
    ),
    "virtual machine": ({"sys/class/drm/renderD128/device/vendor": "0x1af4\n"}, []),
}


@pytest.mark.parametrize("machine", MACHINES)
def test_gpus_are_found_and_named_where_they_are_not_used(machine: str, tmp_path: Path) -> None:
    files, names = MACHINES[machine]
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert _gpus(tmp_path) == names
    unused, used = _gpu(names, is_used=False), _gpu(names, is_used=True)
    assert unused.works == (not names)
    assert used.works
    assert not unused.needed
    assert all(name in unused.detail and name in used.detail for name in names)
    assert bool(unused.remedy) == bool(names)
