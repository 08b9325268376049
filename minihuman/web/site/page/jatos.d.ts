/** What a site uses of `jatos.js`, by its reference (read 29 November 2026). */
declare const jatos: {
  onLoad(callback: () => void): void;
  urlQueryParameters: Record<string, string>;
  appendResultData(text: string): Promise<unknown>;
  abortStudy(message: string, showEndPage: boolean): void;
  endStudy(isSuccessful: boolean, message: string, showEndPage: boolean): void;
};
