"""From the fingertips to the wire: USB, and the thread that keeps a read pending."""
