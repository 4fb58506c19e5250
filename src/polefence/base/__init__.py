"""What everything stands on: errors, files from strangers, worker processes, time limits."""
