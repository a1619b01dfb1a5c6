"""The driver's window: live view, instruments, small map."""
