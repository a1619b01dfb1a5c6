"""The folder of a dataset: its names, its description, its readers."""
