"""Heat transfer mechanisms: conduction, convection, radiation, contact, sources."""
