"""The parts of `polefence.response.drive`: what moves, what measures, what is judged."""
