"""Tool of the repository that writes our OpenDRIVE towns from short readable plans; it is not installed."""
