"""What the commands do; `jaxthermo.__main__` reads their arguments."""
