"""What is compiled: the steps of landmark EKF-SLAM on preallocated arrays."""
