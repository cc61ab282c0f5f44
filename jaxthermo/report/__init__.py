"""Tables, charts, contact sheets and HTML pages for people who read results."""
