"""The reducer's rules: what events change, and what each vehicle is told to do next."""
