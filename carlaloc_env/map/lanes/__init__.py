"""The lane network: centre lines, topology, signals, crosswalks."""
