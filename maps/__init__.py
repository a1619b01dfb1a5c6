"""The towns: one folder each with town.xodr and town.toml."""
