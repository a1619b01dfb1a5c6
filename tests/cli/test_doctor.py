"""Graphics that are there and unused: the system's files of real machines, and what the doctor finds."""

from pathlib import Path

import pytest

from recorder.doctor import _gpu, _gpus

NVIDIA, CARD = "proc/driver/nvidia/gpus/0000:01:00.0/information", "sys/class/drm/renderD{}/device/vendor"
MACHINES: tuple[tuple[dict[str, str], list[str]], ...] = (
    ({}, []),
    ({NVIDIA: "Model: \t\t NVIDIA H200\nIRQ:   \t\t 41\n", "dev/nvidia0": ""}, ["NVIDIA H200"]),
    ({"dev/nvidia0": "", "dev/nvidia1": "", "dev/nvidiactl": ""}, ["NVIDIA", "NVIDIA"]),
    (
        {NVIDIA: "Model: \t A2000\n", CARD.format(128): "0x8086\n", CARD.format(129): "0x10de\n"},
        ["A2000", "Intel"],
    ),
    ({CARD.format(128): "0x1af4\n"}, []),
)
"""The system's files of no GPU, a container, a sandbox, a laptop and a virtual machine, and names of GPUs."""


@pytest.mark.parametrize(("files", "names"), MACHINES)
def test_gpus_are_found_and_named_where_they_are_not_used(
    files: dict[str, str], names: list[str], tmp_path: Path
) -> None:
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert _gpus(tmp_path) == names
    unused, used = _gpu(names, is_used=False), _gpu(names, is_used=True)
    assert (unused.works, unused.needed, used.works) == (not names, False, True)
    assert bool(unused.remedy) == bool(names)
    assert all(name in unused.detail and name in used.detail for name in names)
