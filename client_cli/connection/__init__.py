"""The client's connection to a farm: address and token, requests, downloads, retries."""
