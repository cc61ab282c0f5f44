"""Actions of the commands; `jaxthermo.__main__` reads their arguments."""
