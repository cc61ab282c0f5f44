"""The code against numbers that others have published or that have a closed form."""
