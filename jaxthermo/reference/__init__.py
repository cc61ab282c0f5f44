"""Closed forms that tests and reports compare against."""
