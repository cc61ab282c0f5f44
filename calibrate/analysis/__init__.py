"""What a fit is worth: identifiability, errors, speed."""
