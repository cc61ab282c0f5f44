"""Results of searches, remembered within a process and stored for the next one."""
