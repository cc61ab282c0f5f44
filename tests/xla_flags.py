"""Flags of XLA with which tests compile fast.

Most programs run once, and take longer to compile than to run. Without LLVM's
optimization and MLIR's fusion emitters they compile in less than a third of the time;
in one piece rather than 32, in a twentieth less again.
"""

from importlib.metadata import version

from packaging.version import Version


HAS_FUSION_EMITTERS_FLAG = Version(version("jaxlib")) < Version("0.11")
"""Later ones have no other emitters, and a flag that is not known ends the process."""

_FLAGS = (
    "--xla_backend_optimization_level=0",
    "--xla_cpu_parallel_codegen_split_count=1",
)
_OLD_FLAGS = ("--xla_cpu_use_fusion_emitters=false",)

FAST_COMPILATION = " ".join(_FLAGS + _OLD_FLAGS * HAS_FUSION_EMITTERS_FLAG)
"""The value of the variable `XLA_FLAGS`."""
