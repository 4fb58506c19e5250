"""Given a law: its region and bounds proved in exact arithmetic, or refuted; its margins."""
