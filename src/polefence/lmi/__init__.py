"""Linear matrix inequalities: the conditions of the theory, and the search for their points."""
