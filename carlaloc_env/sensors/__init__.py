"""One module per sensor: its Config and its Sensor."""
