"""Where emulated devices plug in: VISA library, serial URL, USB backend, and a server for other processes."""
