"""From numbers to truth: certificates, their exact proof, and counterexamples."""
