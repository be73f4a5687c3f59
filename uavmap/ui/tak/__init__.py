"""The live map for TAK (Team Awareness Kit): a process sends it as Cursor on Target."""
