"""Output into a pipe whose reader is gone, as in ``carlaloc list weathers | head -1``: no word about it."""

import subprocess
import sys
from pathlib import Path

from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.processes.commands import all_commands

from recorder.cli.main import EXIT_PIPE


def test_a_closed_pipe_ends_every_command_quietly(straight_drive: StraightDrive, tmp_path: Path) -> None:
    """Commands that print by themselves, and the help of all others, each in a process of its own."""
    truth = tmp_path / "truth.tum"
    truth.write_text("".join(f"{k} {k} 0 0 0 0 0 1\n" for k in range(1, 30)))
    drive = str(straight_drive.episode)
    printing = [
        ["list", "weathers"],
        ["info", drive],
        ["info", drive, "--json"],
        ["maps", "check", str(straight_drive.town)],
        ["evaluate", str(truth), str(truth), "--json"],
        ["no-such-command", "--json"],
        ["--version"],
    ]
    helps = [[*words, "--help"] for words, _ in all_commands()]
    script = "import sys; from recorder.cli.main import main; sys.exit(main())"
    for words in [*printing, *helps[::16]]:
        command = [sys.executable, "-c", script, *words]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            process.stdout.close()
            told = process.stderr.read()
        assert process.returncode == EXIT_PIPE, words
        assert "Error" not in told, words
