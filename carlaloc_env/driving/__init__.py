"""Physics, traffic and signals, tick by tick: they fill a timeline."""
