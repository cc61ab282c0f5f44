"""Flags of XLA that only some of its versions know; at others it ends the process."""

from importlib.metadata import version

from packaging.version import Version


HAS_FUSION_EMITTERS_FLAG = Version(version("jaxlib")) < Version("0.11")
"""Later ones have no other emitters."""
