"""The least-squares problem: parameters, targets and reference runs."""
