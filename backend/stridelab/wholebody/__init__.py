"""From the centroidal plan to joint motion and torques, with a certificate and a replay in physics."""
