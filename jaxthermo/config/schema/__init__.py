"""Config models, one subject a file; each names the class that its values build."""
