"""The terminal and the results folder of a command, for all three command lines."""
