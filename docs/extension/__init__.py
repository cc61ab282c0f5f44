"""Extensions of the site: equations, measured numbers, and generated references."""
