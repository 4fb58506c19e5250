"""The parts of `polefence.vehicle.driving.drive`: what moves, what measures, what is judged."""
