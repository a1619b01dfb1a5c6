"""Messages of errors: one printable line, of bounded length, whatever a file holds."""

import pickle

from carlaloc_env.core.errors import LENGTH_MAX, ConfigError


def test_message_is_one_printable_line() -> None:
    text = str(ConfigError("no kind 'a\nb\x00\u202ec'\t\r\n. Known: camera"))
    assert text == "no kind 'a b c' . Known: camera"


def test_long_message_keeps_both_ends() -> None:
    text = str(ConfigError("begin " + "x" * 10_000 + " end"))
    assert len(text) <= LENGTH_MAX
    assert text.startswith("begin x")
    assert text.endswith("x end")


def test_errors_cross_processes() -> None:
    error = pickle.loads(pickle.dumps(ConfigError("a\nb")))
    assert isinstance(error, ConfigError)
    assert str(error) == "a b"
