"""Heat to moving and still air."""
