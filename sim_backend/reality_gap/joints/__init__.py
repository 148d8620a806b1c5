"""Which causes are at work in joints: equations a healthy robot fulfils, what each effect adds, fit and verdict."""
