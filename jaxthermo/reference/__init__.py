"""Closed-form solutions that tests and reports compare against."""
