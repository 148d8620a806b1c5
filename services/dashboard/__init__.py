"""The farm in a browser: pages rendered on the server, with the same functions as the API's routes."""
