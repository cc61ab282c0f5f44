"""Time: solvers, the energy ledger, and `simulate`."""
