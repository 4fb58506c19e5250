"""Laws for regions and for signals: searched in floats, proved in exact arithmetic."""
