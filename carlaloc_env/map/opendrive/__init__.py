"""OpenDRIVE: the file's records, the reader, and the evaluation of roads as curves and surfaces."""
