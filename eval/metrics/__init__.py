"""What is measured of flights, and the summary of an evaluation."""
