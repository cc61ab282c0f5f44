"""The run: time loop, save intervals, energy ledger, solution."""
