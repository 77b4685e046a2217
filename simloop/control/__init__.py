"""Control: what may be driven of what is asked, and the motor loops."""
