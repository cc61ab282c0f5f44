"""Cases, checks, verdicts, timing and records that all experiments share."""
