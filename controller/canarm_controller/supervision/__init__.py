"""What a controller notices of its robot: measurements, commands and arrivals judged against each other."""
