"""Sub-commands of `carlaloc`, one module each, with `add_arguments` and `run`."""
