"""What is answered: waypoints, reasons and the certificate."""
