"""What is wrong with plans and with what is published of them."""
