"""What all rooms need of the machine: devices, the console, atomic writes, safe reading, and errors of parsing."""
