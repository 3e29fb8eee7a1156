"""What moves a mechanism, and what stands between the motor and the link."""
