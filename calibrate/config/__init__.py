"""Calibration configurations: schema and loader."""
