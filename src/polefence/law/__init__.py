"""Laws: one gain, a gain scheduled on the parameters, a table of gains."""
