"""The robustness cases behind `thirdbody hard`."""
