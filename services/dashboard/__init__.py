"""The farm in a browser: pages made by the server over the same functions that the API's routes call."""
