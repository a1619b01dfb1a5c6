"""Dataset formats that are folders of files."""
