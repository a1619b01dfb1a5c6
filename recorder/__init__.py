"""Everything after the environment: record, replay, write datasets, evaluate."""
