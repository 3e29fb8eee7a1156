"""Motors, and the elements between motor and link: gears, friction, springs, contacts."""
