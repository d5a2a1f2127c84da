"""What is asked for: limits and requirement, reports, the route, and who of the traffic counts."""
