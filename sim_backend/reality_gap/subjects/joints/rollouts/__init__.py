"""Windows of the recordings, simulated from where the robot was: with which model does it go where the robot went?"""
