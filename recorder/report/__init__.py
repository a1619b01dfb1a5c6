"""Images and tables for people."""
