"""How the client reaches a farm: address and token, requests, downloads, patience."""
