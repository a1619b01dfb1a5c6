"""Pictures beside PyTorch in one process."""

import importlib.util
import subprocess
import sys

import pytest

LEARN = """
from carlaloc_env.render.gl_context import create_context
create_context()
import torch
torch.optim.Adam(torch.nn.Linear(2, 2).parameters())
"""
"""A camera, then an optimiser, as an agent with a camera makes them."""


def test_an_optimiser_can_be_made_after_a_camera() -> None:
    """Two LLVMs in one process do not crash it: PyTorch's Triton loads the second one with the optimiser."""
    for name in ("torch", "triton"):
        if importlib.util.find_spec(name) is None:
            pytest.skip(f"needs {name}: extra `learn`, and a wheel of PyTorch for GPUs")
    made = subprocess.run([sys.executable, "-c", LEARN], capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
