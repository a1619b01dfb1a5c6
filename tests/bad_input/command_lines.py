"""Command lines drawn from the parsers themselves, so that a new option is hunted without being told."""

import argparse
from pathlib import Path

import hypothesis.strategies as st

from recorder.cli import main as cli

LONG_COMMANDS = ("doctor", "dataset")
"""Commands that work for minutes, whatever they are given."""
SHORTLY = {"record": ["--duration", "0.05"], "replay": ["--duration", "0.05", "--rig", "state"]}
"""What keeps a command that happens to be right from working for minutes."""
WORDS = [
    "", "0", "-1", "1", "0.05", "nan", "inf", "1e9", "99999999999999999999", "Town03", "town3", "../x", "/",
    "ClearNoon", "ClearNoon,,x", "dynamic", "static", "2", "-0.5", "dynamic,vehicles=-1", "paper", "state",
    "rosbag1", "euroc,euroc", "low", "ultra", "se3", "posyaw", "scripted", "wheel", "a\nb", "ä", "x" * 300,
    "%s", "--", "--force", "--json",
]  # fmt: skip
"""Values, most of them wrong for most options."""


def command_lines(episode: Path, tum: Path, work: Path) -> st.SearchStrategy[list[str]]:
    """Arguments of `carlaloc`, most of them wrong somewhere.

    Args:
        episode: An episode that exists.
        tum: A trajectory that exists.
        work: Folder for what commands write.
    """
    files = [str(path) for path in (episode, tum, work, work / "missing.mcap", work / "out" / "a.png")]
    values = st.one_of(st.sampled_from(WORDS), st.sampled_from(files), st.text(max_size=8))
    return st.composite(_drawn)(values)


def _drawn(draw: st.DrawFn, values: st.SearchStrategy[str]) -> list[str]:
    parser = cli.make_parser()
    argv: list[str] = []
    while (choices := _choices(parser)) is not None:
        name = draw(st.sampled_from(sorted(set(choices) - set(LONG_COMMANDS))))
        argv.append(name)
        parser = choices[name]
    for action in parser._actions:
        if not action.option_strings:
            argv += [draw(values)] * draw(st.sampled_from([1, 1, 1, 0, 2]))
        elif draw(st.integers(0, 3)) == 0:
            argv.append(draw(st.sampled_from(action.option_strings)))
            if action.nargs != 0:
                argv.append(draw(values))
    if draw(st.integers(0, 9)) == 0:
        argv.insert(draw(st.integers(0, len(argv))), draw(values))
    return argv + SHORTLY.get(argv[0], [])


def _choices(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser] | None:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return None
